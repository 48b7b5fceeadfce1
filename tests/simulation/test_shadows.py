from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tomoslam_stage.simulation.bodies import Blob, Ellipsoid, Solids
from tomoslam_stage.simulation.placing import upright
from tomoslam_stage.simulation.shadows import (
    BLOCK,
    Frame,
    line_integrals,
    projection_directions,
    slice_through,
)

PLACE = np.array([21.0, -13.0, 9.0])
AXIS, MIDDLE_ROW = 47.3, 39.5


def ball() -> Solids:
    return Solids(Ellipsoid(), PLACE[None], upright(1), np.full((1, 3), 5.0), np.array([0.1]))


def mass_centre(picture: NDArray[np.float64]) -> tuple[float, float]:
    rows, columns = np.indices(picture.shape)
    total = picture.sum()
    return float((columns * picture).sum() / total), float((rows * picture).sum() / total)


@pytest.mark.parametrize("theta", [0.0, 0.5, 2.0, 4.5, -1.0])
def test_centre_of_mass_follows_the_sinusoid(theta: float) -> None:
    frame = Frame(projection_directions(theta, 0.0), (AXIS, MIDDLE_ROW), (80, 100))
    column, row = mass_centre(line_integrals([ball()], frame))
    assert column == pytest.approx(AXIS + 21 * np.cos(theta) + 9 * np.sin(theta), abs=0.01)
    assert row == pytest.approx(MIDDLE_ROW - 13, abs=0.01)


@pytest.mark.parametrize("theta", [0.0, 1.2, 3.6])
def test_roll_moves_columns_with_the_row_and_rows_with_the_column(theta: float) -> None:
    roll = np.deg2rad(1.5)
    frame = Frame(projection_directions(theta, roll), (AXIS, MIDDLE_ROW), (80, 100))
    column, row = mass_centre(line_integrals([ball()], frame))
    u = 21 * np.cos(theta) + 9 * np.sin(theta)
    assert column == pytest.approx(AXIS + u + roll * -13, abs=0.02)
    assert row == pytest.approx(MIDDLE_ROW - 13 - roll * u, abs=0.02)


def test_half_a_turn_on_the_projection_is_its_own_mirror_image() -> None:
    there = Frame(projection_directions(0.7, 0.0), (49.5, 39.5), (80, 100))
    back = Frame(projection_directions(0.7 + np.pi, 0.0), (49.5, 39.5), (80, 100))
    blob = Solids(Blob(), PLACE[None], upright(1), np.full((1, 3), 3.0), np.array([0.1]))
    first, second = line_integrals([blob], there), line_integrals([blob], back)
    assert mass_centre(first)[0] > 60
    np.testing.assert_allclose(second[:, ::-1], first, atol=1e-3 * first.max())


def test_many_blocks_of_pixels_add_up_like_single_bodies() -> None:
    rng = np.random.default_rng(0)
    n = 60
    half = rng.uniform(4, 14, (n, 3))
    many = Solids(Ellipsoid(), rng.uniform(-20, 20, (n, 3)), upright(n), half, rng.random(n))
    frame = Frame(projection_directions(0.4, 0.0), (49.5, 39.5), (80, 100))
    assert (4 * half[:, :2].prod(axis=1)).sum() > BLOCK
    single = sum(line_integrals([many.chosen(np.arange(n) == k)], frame) for k in range(n))
    np.testing.assert_allclose(line_integrals([many], frame), single, rtol=1e-10, atol=1e-10)


def test_bodies_partly_and_wholly_out_of_view_are_cut_off() -> None:
    frame = Frame(projection_directions(0.0, 0.0), (49.5, 39.5), (80, 100))
    wide = Frame(frame.directions, (149.5, 139.5), (280, 300))
    centre = np.array([[48.0, 0, 0], [0, 41.0, 0], [90.0, 0, 0], [-80.0, -70.0, 0]])
    edge = Solids(Ellipsoid(), centre, upright(4), np.full((4, 3), 6.0), np.ones(4))
    seen = line_integrals([edge], wide)[100:180, 100:200]
    np.testing.assert_array_equal(line_integrals([edge], frame), seen)


def test_slice_summed_along_z_is_the_row_of_the_projection_at_angle_zero() -> None:
    centre = np.array([[12.0, 1.0, -7.0], [-9.0, 0.0, 5.0]])
    half = np.array([[3.0, 4.0, 5.0], [5.0, 4.0, 3.5]])
    blobs = Solids(Blob(), centre, upright(2), half, np.array([0.02, 0.01]))
    flat = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    cut = slice_through([blobs], Frame(flat, (59.5, 59.5), (120, 120)), 0.0)
    frame = Frame(projection_directions(0.0, 0.0), (59.5, 20.0), (41, 120))
    # Rows are averaged over their height in a projection and not in a slice: 1 % at most here.
    peak = cut.sum(axis=0).max()
    np.testing.assert_allclose(
        cut.sum(axis=0), line_integrals([blobs], frame)[20], atol=0.01 * peak
    )


def test_slice_shows_x_to_the_right_and_z_downwards_and_only_what_it_meets() -> None:
    flat = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    frame = Frame(flat, (50.0, 50.0), (101, 101))
    met = slice_through([ball()], frame, PLACE[1])
    assert mass_centre(met) == pytest.approx((50 + 21, 50 + 9), abs=0.02)
    assert met.max() == pytest.approx(0.1)
    assert met.sum() == pytest.approx(0.1 * np.pi * 25, rel=0.01)
    assert not slice_through([ball()], frame, PLACE[1] + 5.5).any()
