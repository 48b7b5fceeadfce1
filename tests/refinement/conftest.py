"""Measured steps of known angles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements, Floats, Geometry, Tracks


@pytest.fixture
def measured() -> Callable[..., AngleMeasurements]:
    """Measure the steps of triplets of `theta` (n,), `apart` places apart, all the way along."""

    def made(
        theta: np.ndarray, apart: int = 5, sigma_deg: float = 0.1, said_deg: float | None = None
    ) -> AngleMeasurements:
        first = np.arange(len(theta) - 2 * apart)
        triplets = np.stack([first, first + apart, first + 2 * apart], axis=1)
        noise = np.random.default_rng(17).normal(0, np.deg2rad(sigma_deg), (len(first), 2))
        said = np.deg2rad(sigma_deg if said_deg is None else said_deg)
        return AngleMeasurements(
            projections=triplets,
            steps=np.diff(theta[triplets]) + noise,
            covariance=np.broadcast_to(said**2 * np.eye(2), (len(first), 2, 2)),
            tracks=np.full(len(first), 30),
            inliers=np.full(len(first), 20),
        )

    return made


@pytest.fixture
def unmeasured() -> AngleMeasurements:
    """No triplet at all."""
    none = np.empty(0, np.intp)
    empty = np.empty((0, 3), np.intp), np.empty((0, 2)), np.empty((0, 2, 2))
    return AngleMeasurements(*empty, none, none)


def tracked(  # noqa: PLR0917
    span: float = 360.0,
    projections: int = 120,
    features: int = 120,
    noise: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> tuple[Tracks, Floats, Geometry]:
    """Sight points on an axis that leans, each along a third of a turn of `span` degrees."""
    rng = np.random.default_rng(seed)
    theta = np.deg2rad(np.linspace(0, span, projections, endpoint=False))
    geometry = Geometry(theta, axis=81.3, roll=np.deg2rad(0.2), middle=60.0)
    radius, phase = 70 * np.sqrt(rng.uniform(0.05, 1, features)), rng.uniform(0, 6.3, features)
    position = np.stack([radius * np.cos(phase), radius * np.sin(phase)], axis=1)
    height = rng.uniform(5, 115, features)
    long = projections // 3
    first = rng.integers(0, projections - long, features)
    # Half of the features are seen on the far side, too.
    seen = [np.arange(a, a + long) for a in first]
    seen = [
        np.union1d(k, (k + projections // 2) % projections) if i % 2 else k
        for i, k in enumerate(seen)
    ]
    feature = np.repeat(np.arange(features), [len(k) for k in seen])
    projection = np.concatenate(seen)
    angle = theta[projection]
    u = position[feature, 0] * np.cos(angle) + position[feature, 1] * np.sin(angle)
    # u = ... + roll (row - middle) and row = Y - roll (column - axis), together.
    row, column = height[feature], u + geometry.axis
    for _ in range(3):
        column = u + geometry.axis_at(row)
        row = height[feature] - geometry.roll * (column - geometry.axis)
    wrong = rng.random(len(u)) < outliers
    error = rng.normal(0, noise, len(u)) if noise else np.zeros(len(u))
    error += wrong * rng.uniform(-4, 4, len(u))
    tracks = Tracks(feature, projection, column + error, row, np.bincount(projection))
    return tracks, position, geometry


@pytest.fixture
def sighted() -> Callable[..., tuple[Tracks, Floats, Geometry]]:
    """Make tracks, the places (f, 2) of their features, and the true geometry."""
    return tracked
