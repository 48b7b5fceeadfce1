"""Measured steps of known angles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements


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
