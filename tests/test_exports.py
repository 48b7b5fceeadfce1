"""Angles as other programs read them. Each file was also read by the program itself: see README."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from tomoslam_stage.cli import main
from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.exports import FORMATS, export
from tomoslam_stage.pipeline import check_on_scan, load_pipeline
from tomoslam_stage.scans import ProcessRecord, write_companion, write_theta
from tomoslam_stage.stages import MODULES

FIXTURE = Path(__file__).parents[1] / "fixtures" / "card_walk_360.h5"
RECORDED = np.arange(240) * 1.5
REFINED = RECORDED + 0.01 * np.sin(RECORDED)


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = Path(shutil.copy(FIXTURE, tmp_path / "scan.h5"))
    write_theta(path, np.radians(REFINED), np.full(240, 1e-4), ProcessRecord())
    return path


@pytest.fixture
def entry(scan: Path, tmp_path: Path) -> Path:
    """The same scan as an NXtomo entry: two flats, a dark, and a frame that is invalid."""
    path = tmp_path / "scan.nxs"
    keys = np.array([1, 1, 2, 3] + [0] * 240)
    with h5py.File(scan) as old, h5py.File(path, "w") as file:
        for place, name in (
            ("", "NXentry"),
            ("instrument", "NXinstrument"),
            ("sample", "NXsample"),
        ):
            file.require_group(f"/entry/{place}").attrs["NX_class"] = name
        detector = file.create_group("/entry/instrument/detector")
        detector.attrs["NX_class"] = "NXdetector"
        parts = (old["/exchange/data_white"][:2], old["/exchange/data_dark"][:1])
        detector["data"] = np.concatenate([*parts, parts[0][:1], old["/exchange/data"][()]])
        detector["image_key"] = keys
        file["/entry/definition"] = "NXtomo"
        file["/entry/sample/rotation_angle"] = np.concatenate([np.zeros(4), REFINED])
        file["/entry/sample/rotation_angle"].attrs["units"] = "degree"
    return path


def test_a_list_of_angles_has_every_digit(scan: Path) -> None:
    for name in ("text", "nabu"):
        (path,) = export(scan, name)
        assert path == scan.with_name(f"scan_{name}.txt")
        np.testing.assert_array_equal(np.loadtxt(path), np.degrees(np.radians(REFINED)))


def test_frames_that_are_no_projections_have_no_line(entry: Path) -> None:
    (path,) = export(entry, "nabu")
    np.testing.assert_allclose(np.loadtxt(path), REFINED, atol=1e-12)


def test_imod_gets_refined_tilts_with_the_recorded_ones_beside_them(scan: Path) -> None:
    written = export(scan, "imod", scan.with_name("series.tlt"))
    assert [path.name for path in written] == ["series.tlt", "series.rawtlt"]
    for path, angles in zip(written, (REFINED, RECORDED), strict=True):
        np.testing.assert_allclose(np.loadtxt(path), angles, atol=5e-6)
        assert {len(line) for line in path.read_text().splitlines()} == {11}


def test_a_pipeline_for_httomo_is_one_of_ours_that_fits_the_scan(scan: Path, entry: Path) -> None:
    for path, angles in (
        (scan, "/exchange/theta"),
        (entry, "/entry/sample/rotation_angle"),
    ):
        (written,) = export(path, "httomo")
        loader, *others = yaml.safe_load(written.read_text())
        assert loader["parameters"]["rotation_angles"] == {"data_path": angles}
        assert [each["method"] for each in others][-1] == "recon"
        ours = load_pipeline(written)[:1]
        assert check_on_scan(ours, MODULES, path).n_projections == 240


def test_flats_and_darks_for_httomo_are_of_one_file_under_two_names(scan: Path) -> None:
    (written,) = export(scan, "httomo")
    assert written.read_text().startswith("# For one scan")
    loader = yaml.safe_load(written.read_text())[0]["parameters"]
    files = [Path(loader[name]["file"]) for name in ("darks", "flats")]
    # HTTomo 3.0 compares the paths themselves, and would take flats for darks in one dataset.
    assert files[0] != files[1]
    assert all(file.is_absolute() and file.samefile(scan) for file in files)


def test_a_companion_is_exported_like_a_scan(scan: Path, tmp_path: Path) -> None:
    companion = tmp_path / "companion.h5"
    write_companion(companion, scan, np.radians(REFINED + 1), np.full(240, 1e-4), ProcessRecord())
    (path,) = export(companion, "text")
    np.testing.assert_allclose(np.loadtxt(path), REFINED + 1)


def test_what_cannot_be_exported_is_said(scan: Path, tmp_path: Path) -> None:
    with pytest.raises(PipelineError, match="Did you mean 'nabu'"):
        export(scan, "nab")
    before = scan.read_bytes()
    with pytest.raises(PipelineError, match="is the scan itself"):
        export(scan, "text", scan)
    assert scan.read_bytes() == before
    with h5py.File(scan, "r+") as file:
        file["/exchange/theta"][3] = np.nan
    with pytest.raises(ScanError, match="no finite angle for each of 240 projections"):
        export(scan, "text", tmp_path / "x.txt")
    assert not (tmp_path / "x.txt").exists()


def test_the_command_says_what_to_do_with_each_file(
    scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in FORMATS:
        assert main(["export", str(scan), "--format", name]) == 0
    said = capsys.readouterr().out
    assert "angles_file = " in said
    assert "httomo run" in said
    assert main(["export", str(scan), "--format", "savu"]) == 2


def test_viewers_of_nexus_files_plot_the_correction(scan: Path) -> None:
    nxdata = pytest.importorskip("silx.io.nxdata", reason="a check of the neighbour itself")
    with h5py.File(scan) as file:
        plot = nxdata.get_default(file["/process/tomoslam_stage"])
        assert plot.is_valid
        assert (plot.signal_name, plot.axes_names) == ("correction (deg)", ["frame"])
        assert plot.errors.shape == (240,)
