"""refine_theta on arrays."""

from __future__ import annotations

import os

import numpy as np
import pytest

from tomoslam_stage import refine_theta
from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.geometry import rms, rms_difference
from tomoslam_stage.heldout import hold_out
from tomoslam_stage.products import Refinement
from tomoslam_stage.refinement import Halves
from tomoslam_stage.scans import scan_of
from tomoslam_stage.simulation import SimulatedScan
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Clock, Work
from tomoslam_stage.tracks import Tracking


def test_a_lost_step_is_found_and_the_refined_angles_stand(
    grains: SimulatedScan, refined: Refinement
) -> None:
    assert refined.status == "accepted"
    assert refined.theta is refined.refined
    np.testing.assert_array_equal(refined.recorded, grains.theta_recorded)
    before, after = (
        rms_difference(t, grains.theta_true) for t in (refined.recorded, refined.theta)
    )
    assert np.rad2deg(after) < 0.04 < np.rad2deg(before) / 30
    (event,) = refined.events
    assert (event.projection, event.kind) == (45, "lost step")
    assert event.size_deg == pytest.approx(-2.5, abs=0.1)
    assert refined.evidence is not None
    assert refined.evidence.residual_refined < refined.evidence.residual_recorded
    assert refined.reason.startswith("two halves of the data put the error of the refined angles")


def test_refinement_says_how_sure_it_is_and_what_it_counted(
    grains: SimulatedScan, refined: Refinement
) -> None:
    assert refined.sigma.shape == refined.refined.shape
    error = rms_difference(refined.refined, grains.theta_true)
    assert error / 2 < rms(refined.sigma) < 5 * error
    assert set(refined.residuals) == {"prior", "encoder", "cv", "closure"}
    assert refined.sources == {"features": "used", "map": "used"}
    assert refined.counts["sightings"] > 20 * refined.counts["features"] > 1000
    assert refined.counts["keypoints"] > refined.counts["sightings"]
    assert refined.counts["map rows"] > 20
    assert abs(np.rad2deg(refined.roll)) < 0.1
    assert refined.stage_noise is not None
    assert np.rad2deg(refined.stage_noise.step) < 0.05


def test_axis_is_found_and_unused_rows_tell_of_both_sets_of_angles(
    grains: SimulatedScan, integrals: np.ndarray, refined: Refinement
) -> None:
    assert refined.axes["refined"] == pytest.approx(grains.axis, abs=0.5)
    assert refined.axis == refined.axes["refined"]
    for name in ("recorded", "refined"):
        assert refined.reprojection[name].shape == (90,)
    assert rms(refined.reprojection["refined"]) < rms(refined.reprojection["recorded"])
    rows = hold_out(scan_of(integrals, grains.theta_recorded))
    np.testing.assert_array_equal(refined.heldout_rows, rows.heldout)
    assert not rows.usable[refined.heldout_rows].any()


@pytest.mark.parametrize("cores", [1, 4])
def test_angles_are_the_same_bits_on_any_number_of_cores(
    grains: SimulatedScan,
    integrals: np.ndarray,
    refined: Refinement,
    monkeypatch: pytest.MonkeyPatch,
    cores: int,
) -> None:
    seen = []
    see = Tracking.see
    monkeypatch.setattr(
        Tracking, "see", lambda self, *given: seen.append(see(self, *given)) or seen[-1]
    )
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    again = refine_theta(integrals, grains.theta_recorded)
    for name in ("refined", "sigma"):
        np.testing.assert_array_equal(getattr(again, name), getattr(refined, name))
    assert again.axes == refined.axes
    assert again.evidence == refined.evidence
    (one,) = seen
    assert not np.isin(np.rint(one.tracks.row), refined.heldout_rows).any()


@pytest.fixture(scope="module")
def seconds() -> dict[str, float]:
    """By station: what `with_axis` took."""
    return {}


@pytest.fixture(scope="module")
def with_axis(
    grains: SimulatedScan, integrals: np.ndarray, seconds: dict[str, float]
) -> Refinement:
    """What is found when the axis is given."""
    scan = scan_of(integrals, grains.theta_recorded)
    return RefineTheta(axis=grains.axis).refine(scan, Clock(seconds))


def test_a_given_axis_is_taken_as_it_is(
    grains: SimulatedScan, with_axis: Refinement, seconds: dict[str, float]
) -> None:
    assert set(with_axis.axes.values()) == {grains.axis}
    assert rms_difference(with_axis.refined, grains.theta_true) < np.deg2rad(0.04)
    assert set(seconds) == {"axis", "tracks", "features", "map", "graph", "gate"}
    assert all(station > 0 for station in seconds.values())


def test_wide_scans_are_binned_and_everything_is_told_in_px_of_the_scan(
    grains: SimulatedScan,
    integrals: np.ndarray,
    with_axis: Refinement,
) -> None:
    wide = integrals.repeat(2, axis=1).repeat(2, axis=2)
    axis = 2 * grains.axis + 0.5
    found = refine_theta(wide, grains.theta_recorded, axis=axis, width=128)
    np.testing.assert_allclose(found.refined, with_axis.refined, atol=1e-12)
    assert set(found.axes.values()) == {axis}
    np.testing.assert_array_equal(found.heldout_rows, 2 * with_axis.heldout_rows)


PAPER = {"angles": {}, "landmarks": None, "mapping": None}


def test_sigma_of_the_published_way_is_widened_to_what_halves_of_the_tracks_show(
    grains: SimulatedScan, integrals: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[np.ndarray] = []
    monkeypatch.setattr(Halves, "excess", lambda _, sigma: said.append(sigma) or 3.0)
    found = refine_theta(integrals, grains.theta_recorded, axis=grains.axis, **PAPER)
    assert found.status == "accepted"
    assert len(found.residuals["cv"]) == found.counts["triplets measured"] > 20
    assert any(name.startswith("triplets failed: ") for name in found.counts)
    np.testing.assert_array_equal(found.sigma, 3.0 * said[0])


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        (PAPER, "no triplet of projections could be measured ("),
        ({"mapping": None}, "features left out: "),
    ],
)
def test_recorded_angles_are_kept_where_nothing_can_be_followed(
    run, smooth_file, tmp_path, asked: dict[str, object], reason: str
) -> None:
    work = Work(path=smooth_file, folder=tmp_path, dry_run=True)
    found = run(work, "load_scan", "refine_theta", axis=65.5, **asked).refinement
    assert found.status == "kept"
    assert found.theta is found.recorded
    assert found.reason.startswith(reason)
    assert found.axes["refined"] == found.axes["recorded"] == found.axis
    np.testing.assert_array_equal(found.reprojection["refined"], found.reprojection["recorded"])
    assert found.evidence is None
    assert not found.change.any()


@pytest.mark.parametrize("shape", [(20, 2, 80), (5, 1, 1), (3, 40, 50)])
def test_scans_with_nothing_to_see_are_kept_without_a_word(shape: tuple[int, int, int]) -> None:
    theta = np.linspace(0, np.pi, shape[0])
    found = refine_theta(np.zeros(shape), theta, axis=(shape[2] - 1) / 2)
    assert found.status == "kept"
    np.testing.assert_array_equal(found.theta, theta)


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"trakcs": {}}, r"refine_theta: no parameter 'trakcs'\. Did you mean 'tracks'\?"),
        (
            {"tracks": {"detector": "shift"}},
            r"tracks\.detector: no method 'shift'\. Did you mean 'sift",
        ),
        (
            {"tracks": {"follower": {"method": "runs", "reach": 0}}},
            r"tracks\.follower\.runs\.reach: 0",
        ),
        ({"width": 10}, r"refine_theta\.width: 10 does not fit"),
        (
            {"angles": {"steps_deg": [95.0]}},
            r"refine_theta\.angles\.steps_deg\.0: 95\.0 does not fit",
        ),
        ({"refinement": {"factors": {"cv": {}}}}, r"the factor 'prior' is missing"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(parameters: dict[str, object], says: str) -> None:
    with pytest.raises(PipelineError, match=says):
        refine_theta(np.zeros((4, 8, 8)), np.zeros(4), **parameters)


def test_angles_that_do_not_fit_the_projections_are_refused() -> None:
    with pytest.raises(ScanError, match=r"\(5,\) angles for 4 projections"):
        refine_theta(np.zeros((4, 8, 8)), np.zeros(5))
