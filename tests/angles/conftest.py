"""Tracks of features whose places, and so all angles, are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.products import Tracks


def columns_of(theta: np.ndarray, count: int, seed: int, radius: float = 120.0) -> np.ndarray:
    """(count, n) px from the axis: random features in a disc, seen at `theta` (n,)."""
    rng = np.random.default_rng(seed)
    distance, phase = radius * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    return distance[:, None] * np.cos(np.asarray(theta) - phase[:, None])


@pytest.fixture
def columns() -> Callable[..., np.ndarray]:
    """Columns (t, n) of random features at n angles, without error."""
    return columns_of


@pytest.fixture
def tracked() -> Callable[..., Tracks]:
    """Tracks of features that are seen all the way round."""

    def made(theta: np.ndarray, count: int = 40, axis: float = 0.0, scatter: float = 0.0) -> Tracks:
        n = len(theta)
        noise = np.random.default_rng(99).normal(0, scatter, (count, n))
        return Tracks(
            feature=np.repeat(np.arange(count), n),
            projection=np.tile(np.arange(n), count),
            column=(columns_of(theta, count, seed=5) + axis + noise).ravel(),
            row=np.repeat(np.linspace(0, 200, count), n),
            keypoints=np.full(n, count),
        )

    return made
