"""Samples that moved on the stage: a column shift of each projection among the unknowns."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage import reconstruct, refine_theta, write_theta
from tomoslam_stage.cli import main
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.geometry import rms, rms_difference
from tomoslam_stage.products import Floats
from tomoslam_stage.scans import binned, read_truth, scan_of
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate
from tomoslam_stage.stages import Work
from tomoslam_stage.stages.refining import RefineTheta, Unused

JITTERED = {
    "phantom": {"method": "grains", "grains": 200, "seed": 7},
    "angle_errors": [{"method": "walk", "sigma_deg": 0.1}],
    "n_projections": 90,
    "rows": 64,
    "columns": 96,
    "shift_px": 0.5,
    "seed": 7,
}
QUICK = {"rows_first": 8, "steps_first": 4, "rows": 16, "steps": 5, "strengths": [0.0, 0.02]}
Run = Callable[..., Work]
Written = Callable[[Path, SimulatedScan], Path]
FREE = ["theta", "axis", "roll", "shift"]


@pytest.fixture(scope="module")
def made() -> SimulatedScan:
    """A scan of a sample that jitters by half a pixel."""
    return simulate(recipe_from(JITTERED))


@pytest.fixture(scope="module")
def refined(
    tmp_path_factory: pytest.TempPathFactory, made: SimulatedScan, run: Run, written_to: Written
) -> Work:
    """What is found in it with shifts among the unknowns, and the slices made of that."""
    path = written_to(tmp_path_factory.mktemp("jittered") / "scan.h5", made)
    work = Work(path=path, folder=path.parent / "report", output=path.parent / "companion.h5")
    run(work, "load_scan", "refine_theta", unknowns=FREE, mapping=QUICK)
    return run(work, "reconstruct", "compare")


def without_gauge(shift: Floats, theta: Floats) -> Floats:
    """Take off what nobody sees: the axis, and a place of the whole sample."""
    gauge = np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=1)
    return np.asarray(shift - gauge @ np.linalg.lstsq(gauge, shift, rcond=None)[0])


def test_angles_and_shifts_are_found_together(made: SimulatedScan, refined: Work) -> None:
    found = refined.refinement
    assert found is not None
    assert found.status == "accepted"
    assert found.shift is not None
    before, after = (rms_difference(t, made.theta_true) for t in (found.recorded, found.theta))
    assert after < before / 5
    error = rms(without_gauge(found.shift - made.shift, made.theta_true))
    assert error < 0.06 < rms(without_gauge(made.shift, made.theta_true)) / 5


def test_shifts_are_told_in_the_report_and_go_where_provenance_goes(
    made: SimulatedScan, refined: Work, run: Run
) -> None:
    found = refined.refinement
    assert found is not None
    assert found.shift is not None
    run(refined, "write_theta")
    told = json.loads((refined.folder / "report.json").read_text())
    assert told["stage"]["shift_px"] == pytest.approx(np.std(made.shift), rel=0.1)
    assert "together with the angles: axis, roll, shift; a shift of all" in told["gauge"]
    np.testing.assert_array_equal(np.loadtxt(refined.folder / "shift.txt"), found.shift)
    assert refined.output is not None
    with h5py.File(refined.output) as file:
        noted = file["/process/tomoslam_stage/shift_px"]
        np.testing.assert_array_equal(noted[()], found.shift)
        assert noted.attrs["units"] == "pixel"
        sigma = file["/process/tomoslam_stage/shift_sigma_px"]
        np.testing.assert_array_equal(sigma[()], found.shift_sigma)
        assert set(file["/exchange"]) & {"shift", "shift_px"} == set()


def test_slices_of_the_refined_angles_are_made_of_projections_that_stand_still(
    refined: Work,
) -> None:
    assert refined.comparison is not None
    psnr = refined.comparison.similarity["psnr"]
    assert psnr["refined"] > psnr["recorded"] + 6


def test_the_truth_in_the_file_tells_the_shifts(made: SimulatedScan, refined: Work) -> None:
    truth = read_truth(refined.path)
    assert truth is not None
    np.testing.assert_array_equal(truth.shift, made.shift)
    some = read_truth(refined.path, np.array([3, 5]))
    assert some is not None
    np.testing.assert_array_equal(some.shift, made.shift[[3, 5]])


def test_a_script_reconstructs_with_shifts_and_writes_them(refined: Work, tmp_path: Path) -> None:
    scan, found, slices = refined.scan, refined.refinement, refined.reconstructions
    assert scan is not None
    assert found is not None
    assert found.shift is not None
    assert slices is not None
    by_pipeline = slices["refined"]
    integrals = scan.source.read(np.arange(90), np.arange(64))
    given = {"rows": by_pipeline.rows.tolist()}
    made = reconstruct(integrals, by_pipeline.theta, by_pipeline.axis, found.shift, **given)
    np.testing.assert_array_equal(made, by_pipeline.slices)
    unaligned = reconstruct(integrals, by_pipeline.theta, by_pipeline.axis, **given)
    assert np.std(unaligned - made) > 0.1 * np.std(made)
    output = tmp_path / "companion.h5"
    write_theta(refined.path, found.refined, output=output, shift=found.shift)
    with h5py.File(output) as file:
        np.testing.assert_array_equal(file["/process/tomoslam_stage/shift_px"][()], found.shift)
    with pytest.raises(PipelineError, match=r"write_theta\.shift: .*90 finite ones are needed"):
        write_theta(refined.path, found.refined, output=output, shift=found.shift[1:])


@pytest.mark.parametrize(
    ("unknowns", "message"),
    [
        (
            ["theta", "shfit"],
            r"refine_theta\.unknowns: no unknown 'shfit'\. Did you mean 'shift'\?",
        ),
        (["axis", "shift"], r"refine_theta\.unknowns: \['axis', 'shift'\]; theta is needed"),
        ("theta", r"refine_theta\.unknowns: 'theta' does not fit"),
    ],
)
def test_unknowns_that_cannot_be_are_refused(unknowns: object, message: str) -> None:
    with pytest.raises(PipelineError, match=message):
        refine_theta(np.zeros((5, 4, 64)), np.arange(5), unknowns=unknowns)


def test_shifts_are_told_in_px_of_the_scan_that_was_given() -> None:
    scan = scan_of(np.zeros((3, 8, 128), np.float32), np.arange(3.0))
    half = Unused(binned(scan, 2), np.arange(1), np.zeros((1, 3, 64), np.float32))
    np.testing.assert_allclose(half.shift_in(scan, np.array([0.0, 0.5, 1])), [0, 1, 2])
    assert half.shift_in(scan, None) is None


def test_unknowns_may_come_in_any_order() -> None:
    assert RefineTheta(unknowns=["shift", "theta", "axis"]).unknowns == ("theta", "axis", "shift")


def test_a_shift_that_is_not_known_is_no_shift_to_reconstruct_with() -> None:
    shift = np.array([0.0, np.nan, 0.0])
    with pytest.raises(PipelineError, match=r"reconstruct\.shift: .*3 finite ones are needed"):
        reconstruct(np.zeros((3, 4, 64), np.float32), np.arange(3.0), 31.5, shift)


def test_loop_closures_take_the_sample_for_still() -> None:
    with pytest.raises(PipelineError, match="shift is unknown, and closures compares projections"):
        refine_theta(np.zeros((5, 4, 64)), np.arange(5.0), unknowns=FREE, closures={})


def test_triplets_take_the_sample_for_still(
    refined: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(refined.path), "--dry-run", "--pipeline", "paper"]
    code = main([*arguments, "--set", "refine_theta.unknowns=[theta, shift]"])
    assert code == 2
    assert "refine_theta.unknowns: shift is unknown, and angles" in capsys.readouterr().err
