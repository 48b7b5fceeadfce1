"""Long scans: key projections are solved for together, the others placed in their map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.geometry import rms, rms_difference
from tomoslam_stage.methods import checked
from tomoslam_stage.products import Pixels, Scan
from tomoslam_stage.scans import scan_of
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate
from tomoslam_stage.stages.refining import Refined, RefineTheta
from tomoslam_stage.stages.work import Clock

N, KEYS, LOST = 300, 100, 136
LONG = {
    "phantom": {"method": "grains", "grains": 300, "seed": 3},
    "angle_errors": [
        {"method": "walk", "sigma_deg": 0.05},
        {"method": "lost_step", "size_deg": 1.5, "projection": LOST},
    ],
    "n_projections": N,
    "rows": 64,
    "columns": 96,
    "seed": 3,
}
MAP = {"rows_first": 8, "steps_first": 4, "rows": 24, "steps": 6, "strengths": [0.0, 0.02]}


@pytest.fixture(scope="module")
def made() -> SimulatedScan:
    """A scan whose stage walks and loses a step between two key projections."""
    return simulate(recipe_from(LONG))


@pytest.fixture(scope="module")
def scan(made: SimulatedScan, flat_fielded: Callable[[SimulatedScan], Pixels]) -> Scan:
    return scan_of(flat_fielded(made), made.theta_recorded)


def refined(scan: Scan, **how: object) -> Refined:
    keyed = {"keyframes": KEYS, "mapping": MAP, "closer": None} | how
    return checked(RefineTheta, keyed, "refine_theta").refined(scan, Clock({}))


@pytest.fixture(scope="module")
def found(scan: Scan) -> Refined:
    return refined(scan)


def test_all_angles_are_found_by_way_of_a_third_of_them(
    made: SimulatedScan, found: Refined
) -> None:
    refinement = found.refinement
    assert refinement.status == "accepted"
    assert refinement.counts["key projections"] == KEYS
    errors = np.rad2deg(refinement.refined - made.theta_true)
    errors -= errors.mean()
    before = rms_difference(refinement.recorded, made.theta_true)
    assert np.rad2deg(before) > 0.4
    assert rms(errors) < 0.06
    key = np.isin(np.arange(N), np.linspace(0, N - 1, KEYS).round())
    assert rms(errors[~key]) < 1.5 * rms(errors[key])


def test_sigma_is_honest_between_key_projections(made: SimulatedScan, found: Refined) -> None:
    errors = found.refinement.refined - made.theta_true
    said = found.refinement.sigma
    assert said.shape == (N,)
    assert 0.5 < np.sqrt(np.mean(((errors - errors.mean()) / said) ** 2)) < 1.4


def test_a_step_lost_between_key_projections_is_named(found: Refined) -> None:
    (event,) = found.refinement.events
    assert (event.projection, event.kind) == (LOST, "lost step")
    assert event.size_deg == pytest.approx(-1.5, abs=0.15)


def test_the_noise_of_the_stage_is_told_per_step_of_the_stage(found: Refined) -> None:
    noise = found.refinement.stage_noise
    assert noise is not None
    assert np.rad2deg(noise.walk) == pytest.approx(0.05, abs=0.02)


def test_everything_is_told_in_numbers_of_all_projections(found: Refined) -> None:
    refinement, tracks = found
    assert {len(each) for each in refinement.reprojection.values()} == {N}
    assert set(refinement.reprojection) == {"recorded", "refined"}
    assert set(refinement.axes) == {"recorded", "refined", "features", "map"}
    assert refinement.residuals["encoder"].shape == (N - 1, 1)
    assert tracks is not None
    assert tracks.keypoints.shape == (N,)
    sighted = np.flatnonzero(tracks.keypoints)
    assert len(sighted) == KEYS
    assert np.isin(tracks.projection, sighted).all()


def test_without_a_map_the_encoder_leads_from_one_key_projection_to_the_next(
    made: SimulatedScan, scan: Scan
) -> None:
    refinement = refined(scan, mapping=None).refinement
    key = np.isin(np.arange(N), np.linspace(0, N - 1, KEYS).round())
    errors = refinement.refined - made.theta_true
    assert refinement.sources == {"features": "used"}
    assert rms_difference(refinement.refined, made.theta_true) < np.deg2rad(0.15)
    assert np.median(refinement.sigma[~key]) > np.median(refinement.sigma[key])
    assert np.sqrt(np.mean(((errors - errors.mean()) / refinement.sigma) ** 2)) < 1.5
