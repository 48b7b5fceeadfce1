"""Matrices of all angles by all angles are few where a map is weighed, too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.mapping.curvature import learn, lift
from tomoslam_stage.mapping.weighing import formal_sigma, whitened
from tomoslam_stage.products import Floats, Layout

Needed = Callable[[Callable[[], object], int], float]

N = 1000
SIZE = N + 2


@pytest.fixture(scope="module")
def curvature() -> Floats:
    """Follow smooth changes, as a map does, so that few of them are left."""
    angle = np.arange(SIZE) * 2 * np.pi / SIZE
    near = np.exp(8 * (np.cos(angle[:, None] - angle) - 1))
    return np.asarray(np.eye(SIZE) - 0.99 * near / near.sum(axis=0))


def test_a_map_is_weighed_within_three_matrices(matrices: Needed, curvature: Floats) -> None:
    variance = np.linspace(1, 2, SIZE)
    pulls = np.ones((3, SIZE))
    assert matrices(lambda: whitened(curvature, variance, pulls), N) < 2.9
    assert matrices(lambda: formal_sigma(curvature, Layout(N)), N) < 1.6


def test_a_curvature_is_lifted_within_two_matrices_and_learns_within_less_than_one(
    matrices: Needed,
    curvature: Floats,
) -> None:
    conditional, change = np.ones(SIZE), np.cos(np.arange(SIZE))
    held = curvature.copy()
    assert matrices(lambda: lift(held, conditional, 0.04, Layout(N)), N) < 2.9
    assert matrices(lambda: learn(held, change, change, conditional), N) < 0.9
