from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import STILL, UNKNOWNS, Floats, Geometry, Tracks, Unknown
from tomoslam_stage.refinement import elimination
from tomoslam_stage.refinement.elimination import eliminated
from tomoslam_stage.refinement.sightings import SLIGHT, Sightings

Sighted = Callable[..., tuple[Tracks, Floats, Geometry]]


def numeric_jacobian(sightings: Sightings, geometry: Geometry, position: Floats) -> Floats:
    """(s, k + 2 f) of the expected columns, by central differences."""
    n, size = geometry.layout.size, geometry.layout.size + position.size
    step = 1e-5

    def residuals(change: Floats) -> Floats:
        moved = position + change[n:].reshape(position.shape)
        return sightings.residuals(geometry.moved(change[:n]), moved)

    return np.stack(
        [(residuals(-step * e) - residuals(step * e)) / (2 * step) for e in np.eye(size)], axis=1
    )


@pytest.fixture(params=["dense", "sparse"])
def multiplied(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Multiply matrices in either way, in blocks smaller than there are features."""
    monkeypatch.setattr(elimination, "FULL", 0.0 if request.param == "dense" else 2.0)
    monkeypatch.setattr(elimination, "BLOCK", 7)


@pytest.mark.usefixtures("multiplied")
@pytest.mark.parametrize("unknowns", [STILL, UNKNOWNS])
def test_the_quadratic_is_the_schur_complement(
    sighted: Sighted, unknowns: tuple[Unknown, ...]
) -> None:
    tracks, position, geometry = sighted(projections=24, features=9, noise=0.3)
    shift = np.random.default_rng(3).normal(0, 0.5, 24)
    geometry = replace(geometry, shift=shift, unknowns=unknowns)
    sightings = Sightings.of(tracks, geometry.theta)
    weights = np.random.default_rng(1).uniform(0.5, 20, tracks.n_sightings)
    step = eliminated(sightings, geometry, position, weights)

    n = geometry.layout.size
    jacobian = numeric_jacobian(sightings, geometry, position)
    full = jacobian.T @ (weights[:, None] * jacobian)
    right = jacobian.T @ (weights * sightings.residuals(geometry, position))
    of_places = full[n:, n:] + SLIGHT * np.eye(position.size)
    taken = full[:n, n:] @ np.linalg.inv(of_places)
    information = full[:n, :n] - taken @ full[n:, :n]
    scale = np.abs(information).max()
    np.testing.assert_allclose(step.quadratic.information, information, atol=1e-7 * scale)
    pull = right[:n] - taken @ right[n:]
    np.testing.assert_allclose(step.quadratic.pull, pull, atol=1e-7 * np.abs(pull).max())

    change = 1e-3 * np.random.default_rng(2).normal(size=n)
    moves = np.linalg.solve(of_places, right[n:] - full[n:, :n] @ change)
    np.testing.assert_allclose(step.moves(change).ravel(), moves, atol=1e-7)


@pytest.mark.usefixtures("multiplied")
def test_the_quadratic_is_positive_semidefinite_and_blind_to_a_turn_of_everything(
    sighted: Sighted,
) -> None:
    tracks, position, geometry = sighted(projections=60, features=30)
    sightings = Sightings.of(tracks, geometry.theta)
    step = eliminated(sightings, geometry, position, np.ones(tracks.n_sightings))
    values = np.linalg.eigvalsh(step.quadratic.information)
    assert values[0] > -1e-9 * values[-1]
    together = np.concatenate([np.ones(len(geometry.theta)), np.zeros(2)])
    along = together @ step.quadratic.information @ together
    assert along < 1e-6 * np.trace(step.quadratic.information)
