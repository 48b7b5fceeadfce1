"""The whole program: words in; files, a summary and an exit code out."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib.resources import files
from io import StringIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from tomoslam_stage.cli import main

SHARED = Path(__file__).parents[2] / "shared" / "scans"
LONG_AGO = 1_500_000_000
AXIS = 65.5
"""px: detector column of the axis of `grains`."""
LOST = (
    "--phantom grains --projections 90 --rows 96 --columns 128 --seed 5 --error lost_step:2.5"
    " --set phantom.seed=5 --set phantom.grains=300 --set axis_offset=2"
)
SMOOTH = "--phantom smooth --projections 40 --rows 16 --columns 64 --seed 5 --error walk:0.2"
QUICK = ("--axis", AXIS, "--set", "refine.tracks.detector.keypoints=300")
"""Makes a run on `grains` short."""
FILES = {"report.html", "report.json", "logbook.png", "comparison.png", "theta.png"}
FILES |= {"theta.txt", "slices.h5"}
SCHEMA = Draft202012Validator(
    json.loads((files("tomoslam_stage.comparison") / "report.schema.json").read_text())
)


@dataclass(frozen=True)
class Ran:
    """What a call of the program left behind."""

    code: int
    out: str
    err: str
    scan: Path
    folder: Path

    @property
    def report(self) -> dict[str, Any]:
        made: dict[str, Any] = json.loads((self.folder / "report.json").read_text())
        return made

    def parameters(self, method: str) -> dict[str, Any]:
        """Return the parameters of an entry as it ran."""
        entry = next(entry for entry in self.report["pipeline"] if entry["method"] == method)
        given: dict[str, Any] = entry["parameters"]
        return given


def called(scan: Path, *words: object, command: str = "") -> Ran:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([*filter(None, [command]), str(scan), *map(str, words)])
    folder = scan.with_name(f"{scan.stem}_tomoslam")
    return Ran(code, out.getvalue(), err.getvalue(), scan, folder)


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def left(path: Path) -> tuple[str, int]:
    """What tells whether anybody wrote to a file."""
    return digest(path), path.stat().st_mtime_ns


def copied(source: Path, folder: Path, name: str = "scan.h5") -> Path:
    path = Path(shutil.copyfile(source, folder / name))
    os.utime(path, (LONG_AGO, LONG_AGO))
    return path


def stored(path: Path, name: str) -> tuple[bytes, str, dict[str, Any]]:
    """Bytes, type and attributes of a dataset in ``/exchange``."""
    with h5py.File(path) as file:
        dataset = file["exchange"][name]
        return dataset[()].tobytes(), dataset.dtype.str, dict(dataset.attrs)


def values(path: Path, place: str) -> np.ndarray:
    with h5py.File(path) as file:
        return np.asarray(file[place][()])


def error_deg(theta_deg: np.ndarray, scan: Path) -> float:
    """Rms error, mean removed."""
    return float(np.std(theta_deg - values(scan, "/simulation/theta_true")))


@pytest.fixture(scope="session")
def grains(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan whose features show that the stage lost a step; nobody writes to it."""
    path = tmp_path_factory.mktemp("end_to_end") / "grains.h5"
    assert called(path, *LOST.split(), command="simulate").code == 0
    return path


@pytest.fixture(scope="session")
def accepted(grains: Path) -> Ran:
    """A run without any option on a copy of `grains`."""
    return called(copied(grains, grains.parent, "accepted.h5"))


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ran, tuple[str, int]]:
    """A run on a scan in which there is nothing to track, and what the scan was like before."""
    folder = tmp_path_factory.mktemp("end_to_end_smooth")
    assert called(folder / "made.h5", *SMOOTH.split(), command="simulate").code == 0
    scan = copied(folder / "made.h5", folder, "smooth.h5")
    before = left(scan)
    return called(scan), before


def test_accepted_angles_end_with_0_and_are_in_the_scan(grains: Path, accepted: Ran) -> None:
    assert accepted.code == 0
    assert accepted.out.startswith("accepted.h5: the refined angles are accepted\n")
    assert 8 <= len(accepted.out.splitlines()) <= 28
    theta = values(accepted.scan, "/exchange/theta")
    assert error_deg(theta, grains) < 0.8 * error_deg(values(grains, "/exchange/theta"), grains)
    assert stored(accepted.scan, "theta_recorded") == stored(grains, "theta")
    sigma = values(accepted.scan, "/exchange/theta_sigma")
    assert np.median(sigma) == pytest.approx(accepted.report["median_sigma_deg"])
    # Equal digit for digit: theta.txt goes on to programs that cannot read the scan.
    np.testing.assert_array_equal(np.loadtxt(accepted.folder / "theta.txt"), theta)
    np.testing.assert_array_equal(
        values(accepted.scan, "/exchange/data"), values(grains, "/exchange/data")
    )


def test_the_folder_beside_the_scan_holds_the_whole_report(accepted: Ran) -> None:
    assert {path.name for path in accepted.folder.iterdir()} == FILES
    for picture in accepted.folder.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert picture.stat().st_size > 10_000
    with h5py.File(accepted.folder / "slices.h5") as file:
        assert set(file) == {"recorded", "refined", "true"}
        assert {file[name]["slices"].shape for name in file} == {(3, 128, 128)}
        assert file["refined/axis_px"][()] == pytest.approx(accepted.report["axis_px"])


def test_the_report_of_accepted_angles_has_every_number_that_was_asked_for(
    accepted: Ran,
) -> None:
    report = accepted.report
    SCHEMA.validate(report)
    assert (report["status"], report["n_projections"]) == ("accepted", 90)
    assert report["max_change_deg"] > report["rms_change_deg"] > 0
    assert report["axis_px"] == pytest.approx(AXIS, abs=0.5)
    assert report["n_sightings"] > report["n_features"] > 100
    stations = {"load_scan", "axis", "tracks", "features", "map", "graph", "gate", "reconstruct"}
    assert stations <= report["seconds"].keys()
    assert report["comparison"]["residual_refined"] < report["comparison"]["residual_recorded"]
    assert report["comparison"]["errors"]["error_ratio"] > 1
    assert report["versions"]["numpy"] == np.__version__
    assert [e["method"] for e in report["pipeline"]][-1] == "write_theta"


def test_inspect_tells_of_recorded_and_of_refined_angles(grains: Path, accepted: Ran) -> None:
    before, after = (called(scan, command="inspect") for scan in (grains, accepted.scan))
    for ran, refined in ((before, "no"), (after, "yes")):
        assert ran.code == 0
        lines = {line[:14].strip(): line[14:] for line in ran.out.splitlines()}
        assert lines["projections"] == "90 of 96 rows x 128 columns, uint16"
        assert lines["values"].startswith("counts; ")
        assert lines["refined"].startswith(refined)
        assert lines["problems"] == "none"
    span = [next(line for line in r.out.splitlines() if "angles" in line) for r in (before, after)]
    assert span[0] == span[1]


def test_revert_restores_the_recorded_angles_bit_for_bit(
    grains: Path, accepted: Ran, tmp_path: Path
) -> None:
    scan = copied(accepted.scan, tmp_path)
    assert stored(scan, "theta") != stored(grains, "theta")
    reverted = called(scan, command="revert")
    assert (reverted.code, reverted.out) == (0, f"{scan}: the recorded angles are back\n")
    assert stored(scan, "theta") == stored(grains, "theta")
    with h5py.File(scan) as file:
        assert not {"theta_recorded", "theta_sigma"} & set(file["exchange"])
    again = called(scan, command="revert")
    assert again.code == 3
    assert again.err.startswith("error: scan.h5: ")


def test_kept_angles_end_with_4_and_the_scan_keeps_its_time(
    kept: tuple[Ran, tuple[str, int]],
) -> None:
    ran, before = kept
    assert ran.code == 4
    assert left(ran.scan) == before
    assert {path.name for path in ran.folder.iterdir()} == FILES
    report = ran.report
    SCHEMA.validate(report)
    assert report["status"] == "kept"
    assert report["reason"] in " ".join(ran.out.split())
    assert report["rms_change_deg"] == report["max_change_deg"] == 0
    np.testing.assert_allclose(
        np.loadtxt(ran.folder / "theta.txt"), values(ran.scan, "/exchange/theta"), atol=1e-9
    )


def test_a_dry_run_accepts_and_reports_but_writes_no_angles(grains: Path, tmp_path: Path) -> None:
    scan = copied(grains, tmp_path)
    before = left(scan)
    folder, log = tmp_path / "elsewhere" / "report", tmp_path / "run.log"
    ran = called(scan, "--dry-run", "--report", folder, "--log", log, "--save-slices", *QUICK)
    assert ran.code == 0
    assert left(scan) == before
    assert set(tmp_path.iterdir()) == {scan, folder.parent, log}
    assert {path.name for path in folder.iterdir()} == FILES | {"slices"}
    stacks = {path.name for path in (folder / "slices").iterdir()}
    assert stacks == {"recorded.tif", "refined.tif", "true.tif"}
    assert "dry run, nothing written" in log.read_text()
    report = json.loads((folder / "report.json").read_text())
    assert (report["status"], report["axis_px"]) == ("accepted", AXIS)
    refine = report["pipeline"][1]["parameters"]
    assert refine["axis"] == AXIS
    assert refine["tracks"]["detector"]["keypoints"] == 300
    assert report["counts"]["keypoints"] <= 300 * 90


def test_a_scan_in_radians_gets_a_companion_in_degrees_and_stays_as_it_is(
    grains: Path, tmp_path: Path
) -> None:
    scan, companion = copied(grains, tmp_path), tmp_path / "refined.h5"
    degrees = values(grains, "/exchange/theta")
    with h5py.File(scan, "r+") as file:
        del file["/exchange/theta"]
        file["/exchange/theta"] = np.deg2rad(degrees)
        file["/exchange/theta"].attrs["units"] = "rad"
    os.utime(scan, (LONG_AGO, LONG_AGO))
    before = left(scan)
    ran = called(scan, "--output", companion, *QUICK)
    assert ran.code == 0
    assert left(scan) == before
    assert stored(companion, "theta")[2]["units"] == "deg"
    theta = values(companion, "/exchange/theta")
    assert error_deg(theta, grains) < 0.8 * error_deg(degrees, grains)
    np.testing.assert_array_equal(np.loadtxt(ran.folder / "theta.txt"), theta)
    np.testing.assert_array_equal(
        values(companion, "/exchange/data"), values(scan, "/exchange/data")
    )


def test_bin_and_rows_are_told_in_pixels_of_the_file(grains: Path, tmp_path: Path) -> None:
    scan = copied(grains, tmp_path)
    ran = called(scan, "--bin", 2, "--rows", "30:71:20", "--dry-run")
    assert ran.code == {"accepted": 0, "kept": 4}[ran.report["status"]]
    assert ran.report["scan"]["binning"] == 2
    assert ran.report["scan"]["shape"] == [90, 48, 64]
    assert ran.report["axis_px"] == pytest.approx(AXIS, abs=1)
    assert ran.parameters("reconstruct")["rows"] == [30, 50, 70]
    with h5py.File(ran.folder / "slices.h5") as file:
        assert file["recorded/rows"][()].tolist() == [15, 25, 35]
        assert file["recorded/slices"].shape == (3, 64, 64)


def test_the_paper_pipeline_runs_by_its_name(grains: Path, tmp_path: Path) -> None:
    scan = copied(grains, tmp_path)
    ran = called(scan, "--pipeline", "paper", "--dry-run", "--axis", AXIS)
    assert ran.code == {"accepted": 0, "kept": 4}[ran.report["status"]]
    assert ran.report["n_sightings"] > ran.report["n_features"] > 100
    tracks = ran.parameters("refine_theta")["tracks"]
    assert (tracks["detector"]["method"], tracks["follower"]["method"]) == ("surf", "steps")


def test_a_file_that_is_not_hdf5_ends_with_3(tmp_path: Path) -> None:
    scan = tmp_path / "notes.h5"
    scan.write_text("exposure 0.1 s")
    for command in ("", "inspect", "revert"):
        ran = called(scan, command=command)
        assert (ran.code, ran.out) == (3, "")
        assert ran.err.startswith("error: notes.h5: ")
        assert len(ran.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [scan]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["--set", "refine.trakcs.background=3"], "Did you mean 'tracks'?"),
        (["--set", "refin.axis=3"], "Did you mean 'refine'?"),
        (["--set", "refine.tracks.detector=shift"], "Did you mean 'sift'?"),
        (["--bin", "0"], "load_scan.binning: 0 does not fit"),
        (["--drop-frames", "12-14"], "'12-14' cannot be read; numbers and FROM:BEFORE"),
        (["--drop-angles", "9999"], "load_scan.drop_angles: there is no 9999; angles from 0 to"),
        (["--pipeline", "papper"], "Did you mean 'paper'?"),
    ],
)
def test_a_wrong_word_ends_with_2_before_anything_is_done(
    grains: Path, tmp_path: Path, words: list[str], hint: str
) -> None:
    scan = copied(grains, tmp_path)
    before = left(scan)
    ran = called(scan, *words)
    assert (ran.code, ran.out) == (2, "")
    assert hint in ran.err
    assert left(scan) == before
    assert list(tmp_path.iterdir()) == [scan]


@pytest.fixture
def shared(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy of a scan that lies beside the checkout, which itself is never written to."""
    source = SHARED / request.param
    if not source.is_file():
        pytest.skip(f"the shared scans are not beside the checkout: there is no {request.param}")
    return copied(source, tmp_path, source.name)


@pytest.mark.parametrize(
    ("shared", "codes"),
    [("tooth_2rows.h5", {4}), ("savu_24737.h5", {0, 4})],
    indirect=["shared"],
)
def test_a_real_scan_is_refined_or_kept_and_its_source_is_as_it_was(
    shared: Path, codes: set[int]
) -> None:
    before, source = left(shared), SHARED / shared.name
    untouched = left(source)
    ran = called(shared)
    assert ran.code in codes
    assert ran.report["status"] == {0: "accepted", 4: "kept"}[ran.code]
    assert any(digit in ran.report["reason"] for digit in "0123456789")
    assert {path.name for path in ran.folder.iterdir()} == FILES
    assert left(source) == untouched
    assert (left(shared) == before) == (ran.code == 4)


@pytest.mark.parametrize("shared", ["bone_walk_360.h5"], indirect=True)
def test_angles_of_a_real_object_are_never_accepted_when_they_are_worse(shared: Path) -> None:
    # The axis it would find; looking for it takes a third of the time.
    ran = called(shared, "--dry-run", "--rows", 64, "--axis", 171.5)
    assert ran.code in {0, 4}
    errors = ran.report["comparison"]["errors"]
    assert errors["recorded_rms_deg"] == pytest.approx(0.59, abs=0.01)
    if ran.report["status"] == "accepted":
        assert errors["refined_rms_deg"] < errors["recorded_rms_deg"]
