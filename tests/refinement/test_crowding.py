"""Sightings that are pulled towards the middle where a flat object is seen nearly edge on."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.products import Floats, Geometry, Tracks
from tomoslam_stage.refinement.crowding import crowding
from tomoslam_stage.refinement.sightings import Sightings

N, FEATURES = 180, 80
EDGE_ON = 90
"""The projection in which a plate along X is seen edge on."""
STEADY_PX = 0.1


def points(thickness: float, seed: int = 0) -> Floats:
    """(f, 2) px: points in a plate 120 px wide."""
    rng = np.random.default_rng(seed)
    wide, deep = rng.uniform(-60, 60, FEATURES), rng.uniform(-1, 1, FEATURES)
    return np.stack([wide, thickness * deep], axis=1)


def sighted(position: Floats, pull_px: float) -> tuple[Sightings, Geometry]:
    """Sight all points in half a turn; they are pulled to the middle within 20 degrees of edge on.

    By about as much they scatter there more than elsewhere.
    """
    rng, theta = np.random.default_rng(1), np.deg2rad(np.arange(N, dtype=float))
    feature, projection = np.repeat(np.arange(FEATURES), N), np.tile(np.arange(N), FEATURES)
    x, z = position[feature].T
    across = x * np.cos(theta[projection]) + z * np.sin(theta[projection])
    near = np.abs(projection - EDGE_ON) <= 20
    spread = np.array([np.std(across[projection == k]) for k in range(N)])[projection]
    column = across - near * pull_px * across / spread
    column += rng.normal(0, np.hypot(STEADY_PX, near * pull_px))
    tracks = Tracks(
        feature, projection, column, np.zeros(len(column)), np.full(N, FEATURES, np.intp)
    )
    return Sightings.of(tracks, theta), Geometry(theta, axis=0.0)


def factors(position: Floats, pull_px: float) -> tuple[Floats, Floats, Floats]:
    """(n,) factors, what sightings seem to say about each angle, radians, and what they do say."""
    sightings, geometry = sighted(position, pull_px)
    weights = np.full(len(sightings.column), STEADY_PX**-2)
    found = crowding(sightings, geometry, position, weights)
    direction = np.stack([-np.sin(geometry.theta), np.cos(geometry.theta)], axis=1)
    depth = np.einsum("si,si->s", direction[sightings.projection], position[sightings.feature])
    off = sightings.residuals(geometry, position)
    by_angle = np.bincount(sightings.projection, weights * depth**2, N)
    turned = np.bincount(sightings.projection, weights * depth * off, N) / by_angle
    return found, 1 / np.sqrt(by_angle), turned


def test_sigma_allows_for_a_pull_that_all_features_share() -> None:
    found, seeming, turned = factors(points(thickness=2.0), pull_px=0.15)
    near = np.abs(np.arange(N) - EDGE_ON) <= 15
    said = seeming * np.sqrt(found)
    assert np.sqrt(np.mean((turned / seeming)[near] ** 2)) > 4
    assert 0.5 < np.sqrt(np.mean((turned / said)[near] ** 2)) < 1.5


def test_nothing_is_doubted_where_sightings_scatter_as_usual() -> None:
    found, _, _ = factors(points(thickness=2.0), pull_px=0.0)
    assert np.all(found >= 1)
    assert np.mean(found > 1) < 0.1


def test_an_object_as_deep_as_wide_cannot_be_turned_by_such_a_pull() -> None:
    flat, _, _ = factors(points(thickness=2.0), pull_px=0.15)
    round_, _, _ = factors(points(thickness=60.0), pull_px=0.15)
    near = np.abs(np.arange(N) - EDGE_ON) <= 15
    assert np.median(flat[near]) > 10 * np.median(round_[near])


def test_projections_without_sightings_are_left_alone() -> None:
    position = points(thickness=2.0)
    sightings, geometry = sighted(position, pull_px=0.1)
    weights = np.where(np.isin(sightings.projection, [0, 90]), 0.0, STEADY_PX**-2)
    found = crowding(sightings, geometry, position, weights)
    assert found[[0, 90]] == pytest.approx(1)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(crowding(sightings, geometry, position, 0 * weights), np.ones(N))
