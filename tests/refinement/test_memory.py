"""Matrices of all angles by all angles are few: at 5000 projections each takes 200 MB."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements, Floats, Geometry, Quadratic, Tracks
from tomoslam_stage.refinement import FactorGraph, Landmarks, Said, fused, solver_with
from tomoslam_stage.refinement.factors import Encoder, Prior

Needed = Callable[[Callable[[], object], int], float]

N = 1000
RECORDED = Geometry(np.deg2rad(0.36 * np.arange(N)), axis=30.0)
NONE = AngleMeasurements.none()


def graph(jitter_deg: float) -> FactorGraph:
    encoder = Encoder(sigma_deg=0.05, jitter_deg=jitter_deg)
    return FactorGraph(factors={"prior": Prior(), "encoder": encoder})


@pytest.fixture(scope="module")
def quadratic() -> Quadratic:
    rng = np.random.default_rng(0)
    rows = 300 * rng.normal(size=(N // 4, N + 2))
    information: Floats = rows.T @ rows
    information[np.diag_indices(N + 2)] += 1e6
    return Quadratic(information, 100 * rng.normal(size=N + 2))


# Measured: 1.2 and 2.1 (blocks of rows are large beside so few angles); with copies it was 6.
@pytest.mark.parametrize(("jitter_deg", "most"), [(0.0, 1.6), (0.05, 2.5)])
def test_two_sources_meet_in_one_matrix_more_than_their_own(
    matrices: Needed, quadratic: Quadratic, jitter_deg: float, most: float
) -> None:
    rng = np.random.default_rng(1)
    one = Said(RECORDED, quadratic, rng.normal(size=N + 2), rng.normal(size=(2, N + 2)))
    other = replace(one, geometry=RECORDED.moved(np.full(N + 2, 1e-3)))
    with_graph = graph(jitter_deg)
    assert matrices(lambda: fused(with_graph, RECORDED, NONE, [one, other]), N) < most


def test_a_source_is_answered_with_one_matrix_more_than_its_own(
    matrices: Needed, quadratic: Quadratic
) -> None:
    solve = solver_with(graph(0.0), RECORDED, NONE)
    assert matrices(lambda: solve(RECORDED, quadratic), N) < 1.5


def test_sightings_are_adjusted_within_three_matrices(
    matrices: Needed,
    sighted: Callable[..., tuple[Tracks, Floats, Geometry]],
) -> None:
    tracks, _, geometry = sighted(projections=N, features=40, noise=0.1)
    solve = solver_with(graph(0.0), geometry, NONE)
    how = Landmarks(rounds=2)
    assert matrices(lambda: how.adjust(tracks, geometry, solve), N) < 3.0
