from __future__ import annotations

import h5py
import numpy as np
import pytest
from PIL import Image

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Reconstruction
from tomoslam_stage.scans import write_slices, write_tiffs


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


def test_tiffs_hold_float32_slices_named_by_row(tmp_path, reconstructions):
    written = write_tiffs(tmp_path / "tiff", reconstructions)
    assert [path.name for path in written] == [
        "recorded_row00003.tif",
        "recorded_row00040.tif",
        "refined_row00003.tif",
        "refined_row00040.tif",
    ]
    with Image.open(written[3]) as image:
        np.testing.assert_array_equal(np.asarray(image), reconstructions["refined"].slices[1])


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, reconstructions):
    (tmp_path / "file").write_text("")
    with pytest.raises(ScanError, match="slices: writing failed"):
        write_tiffs(tmp_path / "file" / "tiff", reconstructions)
