"""The angles of a scan are the same to the last bit, however it is worked on."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from tomoslam_stage import refine_theta
from tomoslam_stage.products import Pixels, Refinement
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate

RECIPE = {
    "phantom": {"method": "grains", "grains": 200, "seed": 8},
    "n_projections": 72,
    "rows": 64,
    "columns": 96,
    "axis_offset": 1.5,
    "angle_errors": [{"method": "walk", "sigma_deg": 0.2}],
    "seed": 8,
}


@pytest.fixture(scope="module")
def projections(
    flat_fielded: Callable[[SimulatedScan], Pixels],
) -> tuple[np.ndarray, np.ndarray]:
    """Line integrals (n, row, column) and recorded angles (n,)."""
    scan = simulate(recipe_from(RECIPE))
    return flat_fielded(scan), scan.theta_recorded


def on(cores: int, projections: tuple[np.ndarray, np.ndarray]) -> Refinement:
    with pytest.MonkeyPatch.context() as patch, threadpool_limits(cores):
        patch.setattr(os, "cpu_count", lambda: cores)
        return refine_theta(*projections)


@pytest.fixture(scope="module")
def alone(projections: tuple[np.ndarray, np.ndarray]) -> Refinement:
    """What one worker makes of the whole default refinement."""
    return on(1, projections)


def assert_same_bits(one: Refinement, other: Refinement) -> None:
    for name in ("recorded", "refined", "sigma", "heldout_rows"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert one.axes == other.axes
    assert one.roll == other.roll
    assert (one.status, one.reason) == (other.status, other.reason)
    assert one.evidence == other.evidence
    assert one.counts == other.counts


def test_both_sources_are_asked(alone: Refinement) -> None:
    assert alone.sources == {"features": "used", "map": "used"}
    assert np.degrees(np.std(alone.change)) > 0.1


@pytest.mark.parametrize("cores", [2, 3])
def test_any_number_of_workers_gives_the_same_bits(
    alone: Refinement, projections: tuple[np.ndarray, np.ndarray], cores: int
) -> None:
    assert_same_bits(on(cores, projections), alone)


@pytest.mark.usefixtures("stand_in_functions")
def test_an_installed_backend_changes_nothing(
    alone: Refinement, projections: tuple[np.ndarray, np.ndarray]
) -> None:
    assert sys.modules["tomopy"].__version__ == "stand-in"
    assert_same_bits(on(2, projections), alone)


@pytest.mark.usefixtures("no_tomopy")
def test_a_missing_backend_changes_nothing(
    alone: Refinement, projections: tuple[np.ndarray, np.ndarray]
) -> None:
    with pytest.raises(ImportError):
        __import__("tomopy")
    assert_same_bits(on(2, projections), alone)
