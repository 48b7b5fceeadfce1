"""Projections that do not fit, and those near them, count for less."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.mapping.looking import Look
from tomoslam_stage.mapping.weighing import UNSTEADY, doubts, misfits, variances
from tomoslam_stage.products import STILL, UNKNOWNS, Floats, Geometry

THETA = np.deg2rad(np.arange(0.0, 360.0))


def seen(squares: Floats, noise_left: float = 1.0) -> Look:
    nothing = np.zeros(0)
    return Look(nothing, nothing, squares, nothing, nothing, noise_left)


@pytest.mark.parametrize("mixed", [np.arange(360), np.random.default_rng(1).permutation(360)])
def test_projections_within_eight_degrees_of_a_bad_stretch_are_doubted(mixed: np.ndarray) -> None:
    squares = np.ones((5, 360))
    squares[:, 100:104] = 3.0
    theta, squares = THETA[mixed], squares[:, mixed]
    factors = doubts(seen(squares), theta, 0.5)[np.argsort(mixed)]
    np.testing.assert_allclose(factors[93:111], 1 + ((3 - 1.3) / 0.5) ** 2)
    np.testing.assert_allclose(factors[:92], 1)
    np.testing.assert_allclose(factors[112:], 1)


def test_one_odd_projection_and_usual_scatter_are_not_doubted() -> None:
    squares = np.random.default_rng(4).uniform(0.9, 1.1, (5, 360))
    squares[:, 7] = 9.0
    np.testing.assert_allclose(doubts(seen(squares), THETA, 0.5), 1)


def test_rows_that_were_smoothed_tell_what_others_would() -> None:
    noise, misfit = 1.0, np.where(np.arange(360) % 180 < 6, 2.0, 0.0)
    plain = np.tile(noise + misfit, (5, 1))
    smoothed = np.tile(0.375 * noise + misfit, (5, 1))
    np.testing.assert_allclose(
        misfits(seen(smoothed, 0.375), THETA), misfits(seen(plain), THETA), rtol=1e-12
    )


@pytest.mark.parametrize("unknowns", [UNKNOWNS[:3], UNKNOWNS])
def test_angles_are_as_unsure_as_rows_scatter_around_them(unknowns: tuple[str, ...]) -> None:
    geometry = Geometry(THETA, 0.0, unknowns=unknowns)
    size, rng = geometry.layout.size, np.random.default_rng(8)
    thick = np.abs(THETA - THETA[100]) < np.deg2rad(20)
    sigma = np.ones(size)
    sigma[:360] += 3 * thick
    pulls = sigma * rng.standard_normal((64, size))
    nothing = np.zeros(0)
    look = Look(pulls, nothing, np.ones((64, 360)), nothing, np.zeros(360))
    curvature = 4 * 64 * np.eye(size)
    found = variances(look, geometry, curvature, 0.5)
    np.testing.assert_allclose(found[:360][thick][9:-9], 16 / 4, rtol=0.25)
    np.testing.assert_allclose(found[130:360], 1 / 4, rtol=0.25)
    np.testing.assert_allclose(found[360:362], np.median(found[:360]))
    np.testing.assert_array_equal(found[362:], found[:360][: size - 362])


def test_rows_that_agree_to_the_last_digit_are_not_believed_to_it() -> None:
    geometry, nothing = Geometry(THETA, 0.0), np.zeros(0)
    look = Look(np.ones((8, 362)), nothing, np.full((8, 360), 2.0), nothing, np.zeros(360))
    assert variances(look, geometry, np.eye(362), 0.5).min() == pytest.approx(2e-3)


@pytest.mark.parametrize("unknowns", [STILL, UNKNOWNS])
def test_what_a_shift_would_turn_is_less_sure_unless_shifts_are_unknown(
    unknowns: tuple[str, ...],
) -> None:
    geometry, nothing = Geometry(THETA, 0.0, unknowns=unknowns), np.zeros(0)
    like_a_shift = np.abs(np.arange(360) - 180) < 30
    mixed = np.where(like_a_shift, 4.0, 0.0)
    size = geometry.layout.size
    look = Look(np.zeros((4, size)), nothing, np.full((4, 360), 1e-3), nothing, mixed)
    found = variances(look, geometry, 2 * np.eye(size), 0.5)
    more = 0.0 if "shift" in unknowns else (4 * UNSTEADY) ** 2 / 2
    assert found[180] - found[0] == pytest.approx(more)
