"""Projections that do not fit, and those near them, count for less."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.mapping.weighing import doubts
from tomoslam_stage.products import Geometry

THETA = np.deg2rad(np.arange(0.0, 360.0))


@pytest.mark.parametrize("mixed", [np.arange(360), np.random.default_rng(1).permutation(360)])
def test_projections_within_eight_degrees_of_a_bad_stretch_are_doubted(mixed: np.ndarray) -> None:
    squares = np.ones((5, 360))
    squares[:, 100:104] = 3.0
    theta, squares = THETA[mixed], squares[:, mixed]
    factors = doubts(squares, Geometry(theta, 0.0), 0.5)[:360][np.argsort(mixed)]
    np.testing.assert_allclose(factors[93:111], 1 + ((3 - 1.3) / 0.5) ** 2)
    np.testing.assert_allclose(factors[:92], 1)
    np.testing.assert_allclose(factors[112:], 1)


def test_one_odd_projection_and_usual_scatter_are_not_doubted() -> None:
    squares = np.random.default_rng(4).uniform(0.9, 1.1, (5, 360))
    squares[:, 7] = 9.0
    np.testing.assert_allclose(doubts(squares, Geometry(THETA, 0.0), 0.5), 1)
