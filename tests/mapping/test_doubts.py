"""Projections that do not fit, and those near them, count for less."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.mapping.looking import Look
from tomoslam_stage.mapping.weighing import doubts, misfits
from tomoslam_stage.products import Floats, Geometry

THETA = np.deg2rad(np.arange(0.0, 360.0))


def seen(squares: Floats, noise_left: float = 1.0) -> Look:
    nothing = np.zeros(0)
    return Look(nothing, nothing, squares, nothing, nothing, noise_left)


@pytest.mark.parametrize("mixed", [np.arange(360), np.random.default_rng(1).permutation(360)])
def test_projections_within_eight_degrees_of_a_bad_stretch_are_doubted(mixed: np.ndarray) -> None:
    squares = np.ones((5, 360))
    squares[:, 100:104] = 3.0
    theta, squares = THETA[mixed], squares[:, mixed]
    factors = doubts(seen(squares), Geometry(theta, 0.0), 0.5)[:360][np.argsort(mixed)]
    np.testing.assert_allclose(factors[93:111], 1 + ((3 - 1.3) / 0.5) ** 2)
    np.testing.assert_allclose(factors[:92], 1)
    np.testing.assert_allclose(factors[112:], 1)


def test_one_odd_projection_and_usual_scatter_are_not_doubted() -> None:
    squares = np.random.default_rng(4).uniform(0.9, 1.1, (5, 360))
    squares[:, 7] = 9.0
    np.testing.assert_allclose(doubts(seen(squares), Geometry(THETA, 0.0), 0.5), 1)


def test_rows_that_were_smoothed_tell_what_others_would() -> None:
    noise, misfit = 1.0, np.where(np.arange(360) % 180 < 6, 2.0, 0.0)
    plain = np.tile(noise + misfit, (5, 1))
    smoothed = np.tile(0.375 * noise + misfit, (5, 1))
    np.testing.assert_allclose(
        misfits(seen(smoothed, 0.375), THETA), misfits(seen(plain), THETA), rtol=1e-12
    )
