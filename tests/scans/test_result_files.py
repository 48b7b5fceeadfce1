from __future__ import annotations

import h5py
import numpy as np
import pytest
from PIL import Image

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Reconstruction
from tomoslam_stage.scans import slices, write_slices, write_tiffs


@pytest.fixture
def reconstructions():
    slices = np.random.default_rng(2).normal(size=(2, 5, 5)).astype(np.float32)
    theta = np.radians(np.arange(4.0))
    rows = np.array([3, 40])
    return {
        name: Reconstruction(theta, 2.5, rows, factor * slices, "finufft fbp")
        for name, factor in {"recorded": 1, "refined": 2}.items()
    }


def test_slices_keep_their_values_rows_and_angles(tmp_path, reconstructions):
    write_slices(tmp_path / "slices.h5", reconstructions)
    with h5py.File(tmp_path / "slices.h5") as file:
        assert sorted(file) == ["recorded", "refined"]
        assert file.attrs["default"] == "refined"
        group = file["recorded"]
        np.testing.assert_array_equal(group["slices"], reconstructions["recorded"].slices)
        assert group["slices"].dtype == np.float32
        assert group["rows"][()].tolist() == [3, 40]
        np.testing.assert_allclose(group["theta_deg"], np.arange(4.0))
        assert (group["axis_px"][()], group.attrs["method"]) == (2.5, "finufft fbp")
        assert (group.attrs["NX_class"], group.attrs["signal"]) == ("NXdata", "slices")


def test_an_earlier_file_stays_when_writing_fails(tmp_path, reconstructions):
    write_slices(tmp_path / "slices.h5", reconstructions)
    before = (tmp_path / "slices.h5").read_bytes()
    with pytest.raises(ValueError, match="name"):
        write_slices(tmp_path / "slices.h5", reconstructions | {"": reconstructions["refined"]})
    assert (tmp_path / "slices.h5").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


def test_viewers_find_the_slices_and_their_axes(tmp_path, reconstructions):
    write_slices(tmp_path / "slices.h5", reconstructions)
    with h5py.File(tmp_path / "slices.h5") as file:
        group = file[file.attrs["default"]]
        axes = [group[name] for name in group.attrs["axes"]]
        assert tuple(len(axis) for axis in axes) == group[group.attrs["signal"]].shape
        assert axes[2][()].tolist() == [-2, -1, 0, 1, 2]
        assert axes[2].attrs["units"] == "pixel"


def test_tiffs_are_stacks_of_float32_pages_that_name_their_rows(tmp_path, reconstructions):
    written = write_tiffs(tmp_path / "tiff", reconstructions)
    assert [path.name for path in written] == ["recorded.tif", "refined.tif"]
    assert sorted(path.name for path in written[0].parent.iterdir()) == [p.name for p in written]
    with Image.open(written[1]) as image:
        assert image.n_frames == 2
        assert image.tag_v2[270].endswith("detector rows 3, 40")
        image.seek(1)
        assert image.mode == "F"
        np.testing.assert_array_equal(np.asarray(image), reconstructions["refined"].slices[1])


def test_stacks_beyond_4_gb_take_the_large_format(tmp_path, reconstructions, monkeypatch):
    monkeypatch.setattr(slices, "LARGEST_TIFF", 0)
    write_tiffs(tmp_path, reconstructions)
    # The version in the header: 42 of TIFF, 43 of BigTIFF.
    assert (tmp_path / "recorded.tif").read_bytes()[2] == 43


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, reconstructions):
    (tmp_path / "file").write_text("")
    with pytest.raises(ScanError, match="slices: writing failed"):
        write_tiffs(tmp_path / "file" / "tiff", reconstructions)
