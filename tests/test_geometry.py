from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.geometry import (
    TURN,
    WIDEST_GAP,
    angular_weights,
    around,
    partners,
    rms,
    rms_difference,
    spread,
    triangle_angles,
    triangle_jacobian,
    unseen_shifts,
    wrapped,
)

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats

STEPS = np.array(
    [
        pair
        for pair in product(np.deg2rad([0.5, 4, 5, 10, 33, 60, 90, 120, 160]), repeat=2)
        if sum(pair) < np.deg2rad(179)
    ]
)
"""(m, 2) radians: pairs of steps, many of them unequal, together less than a half turn."""


def normals(steps: Floats) -> Floats:
    """(m, 3) planes of features seen three times, ``steps`` (m, 2) apart."""
    first, second = steps.T
    m = np.sin(second) / np.sin(first)
    k = np.sin(first + second) / np.sin(first)
    return np.stack([m, -k, np.ones_like(m)], axis=-1)


def partners_deg(theta_deg: list[float] | Floats, step_deg: float) -> list[int]:
    return partners(np.deg2rad(theta_deg), np.deg2rad(step_deg)).tolist()


def test_wrapped_angles_lie_from_minus_pi_to_pi_and_differ_by_whole_turns() -> None:
    angles = np.array([0.0, np.pi, -np.pi, 1.5 * np.pi, -1.5 * np.pi, 2.0 + 3 * TURN])
    wanted = [0, -np.pi, -np.pi, -0.5 * np.pi, 0.5 * np.pi, 2.0]
    np.testing.assert_allclose(wrapped(angles), wanted, atol=1e-12)


def test_around_goes_by_the_angle_within_the_turn_and_keeps_the_order_of_equals() -> None:
    theta = np.deg2rad([200.0, 10.0, 370.5, -90.0, 200.0])
    assert around(theta).tolist() == [3, 1, 2, 0, 4]


def test_rounding_moves_no_angle_to_the_other_end_of_the_turn() -> None:
    theta = np.linspace(0, 2 * np.pi, 9)  # the last is where the first is
    for off in (-1e-12, 0.0, 1e-12):
        moved = theta + np.array([off, *np.zeros(7), -off])
        assert sorted(around(moved)[:2].tolist()) == [0, 8]
        assert around(moved)[2:].tolist() == list(range(1, 8))
    alternating = np.tile([1.0, 0.5], 200)
    assert around(alternating).tolist() == [*range(1, 400, 2), *range(0, 400, 2)]


@pytest.mark.parametrize("step", [1, 4, 90, 179])
def test_partners_in_a_full_turn_go_on_past_the_last_projection(step: int) -> None:
    found = partners_deg(np.arange(360.0), step)
    assert found == [(k + step) % 360 for k in range(360)]


def test_partners_in_a_half_turn_end_with_it() -> None:
    assert partners_deg(np.arange(180.0), 4) == [*range(4, 180), *[-1] * 4]


def test_the_nearest_of_unequal_angles_is_the_partner() -> None:
    assert partners_deg([0, 9, 11.5, 20, 31], 10) == [1, 3, 3, 4, -1]


@pytest.mark.parametrize(
    ("other", "found"), [(12.1, -1), (11.9, 1), (8.1, 1), (7.9, -1), (-10.0, -1)]
)
def test_a_partner_may_miss_by_a_fifth_of_the_step(other: float, found: int) -> None:
    assert partners_deg([0, other], 10)[0] == found


def test_partners_do_not_depend_on_the_order_of_the_projections() -> None:
    order = np.random.default_rng(2).permutation(72)
    theta = 5.0 * order
    found = np.array(partners_deg(theta, 10))
    np.testing.assert_allclose(np.mod(theta[found] - theta, 360), 10)


def test_whole_turns_do_not_count_between_partners() -> None:
    theta = np.linspace(-360, 720, 216, endpoint=False)
    found = np.array(partners_deg(theta, 20))
    assert found.min() >= 0
    np.testing.assert_allclose(np.mod(theta[found] - theta, 360), 20)


def test_nobody_is_their_own_partner() -> None:
    assert partners_deg([0, 40], 360) == [-1, -1]
    assert partners_deg([30], 4) == [-1]


@pytest.mark.parametrize("scale", [1.0, 0.02, -3.0])
def test_the_triangle_gives_back_the_steps_that_made_it(scale: float) -> None:
    assert len(STEPS) > 50
    found = triangle_angles(scale * normals(STEPS))
    np.testing.assert_allclose(found, STEPS, atol=1e-8)


def test_features_seen_three_times_lie_in_the_plane_of_the_triangle() -> None:
    x, z = np.random.default_rng(5).uniform(-50, 50, (2, 40))
    theta = 0.3 + np.cumsum(np.insert(STEPS, 0, 0, axis=1), axis=1)
    columns = x[:, None, None] * np.cos(theta) + z[:, None, None] * np.sin(theta)
    np.testing.assert_allclose((columns * normals(STEPS)).sum(axis=-1), 0, atol=1e-8)


def test_lengths_that_make_no_triangle_give_nan_without_a_warning() -> None:
    found = triangle_angles(np.array([[1.0, -2.5, 1.0], [0.0, -1.0, 1.0], [3.0, -1.0, 1.0]]))
    assert np.isnan(found[0]).all()
    assert np.isnan(found[1]).any()
    assert np.isnan(found[2]).all()


@pytest.mark.parametrize("scale", [1.0, -0.7])
def test_the_jacobian_is_the_derivative_of_the_angles(scale: float) -> None:
    normal, step = scale * normals(STEPS), 1e-6
    numerical = np.stack(
        [
            (triangle_angles(normal + move) - triangle_angles(normal - move)) / (2 * step)
            for move in step * np.eye(3)
        ],
        axis=-1,
    )
    clear = np.sin(STEPS).min(axis=1) > 0.05  # finite differences need room
    found = triangle_jacobian(normal, STEPS)
    assert found.shape == (len(STEPS), 2, 3)
    assert clear.sum() > 40
    np.testing.assert_allclose(found[clear], numerical[clear], rtol=1e-5, atol=1e-5)


def test_rms_is_the_root_of_the_mean_square_of_what_is_there() -> None:
    assert rms(np.array([3.0, np.nan, -4.0])) == pytest.approx(np.sqrt(12.5))


def test_rms_difference_does_not_count_a_common_turn() -> None:
    theta = np.array([0.1, 0.5, 0.9, 2.0])
    assert rms_difference(theta + 0.7, theta) == pytest.approx(0, abs=1e-12)
    changed = theta + np.array([1.0, 2.0, 3.0, np.nan])
    assert rms_difference(changed, theta) == pytest.approx(np.sqrt(2 / 3))


@pytest.mark.parametrize(
    ("degrees", "weights"),
    [
        ([0, 10, 30, 90], [50, 15, 40, 75]),
        ([30, 0, 90, 10], [40, 50, 75, 15]),
        ([-170, 210, -90, 0], [15, 40, 75, 50]),
        ([25], [180]),
        ([0, 90, 90, 90], [90, 45, 0, 45]),
        ([0, 180], [90, 90]),
    ],
    ids=["sorted", "unsorted", "outside the half turn", "one", "repeated", "ends of a half turn"],
)
def test_a_projection_weighs_half_the_gap_to_either_neighbour(
    degrees: list[float], weights: list[float]
) -> None:
    found = np.rad2deg(angular_weights(np.deg2rad(degrees)))
    np.testing.assert_allclose(found, weights, atol=1e-9)


@pytest.mark.parametrize("n", [90, 91])
@pytest.mark.parametrize("turns", [0.5, 1, 2])
def test_equal_steps_weigh_the_same_however_often_the_scan_goes_round(n: int, turns: float) -> None:
    weights = angular_weights(np.arange(n) * turns * 2 * np.pi / n)
    np.testing.assert_allclose(weights, np.pi / n, rtol=1e-9)


def test_weights_of_any_angles_add_up_to_the_half_turn() -> None:
    weights = angular_weights(np.random.default_rng(3).uniform(-1, 7, 41))
    assert weights.min() > 0
    assert weights.sum() == pytest.approx(np.pi)


def test_a_wedge_without_projections_weighs_no_more_than_some_usual_gaps() -> None:
    weights = angular_weights(np.deg2rad(np.arange(121.0)))
    assert weights.sum() == pytest.approx(np.pi)
    np.testing.assert_allclose(weights[1:-1], weights[60], rtol=1e-9)
    np.testing.assert_allclose(weights[[0, -1]] / weights[60], (1 + WIDEST_GAP) / 2, rtol=1e-9)


@pytest.mark.parametrize("span", [30, 90, 150])
def test_projections_half_a_turn_apart_do_not_make_every_other_gap_a_wedge(span: int) -> None:
    once = np.deg2rad(np.arange(span + 1.0))
    twice = np.concatenate([once, once + np.pi + 1e-7])
    weights = angular_weights(twice).reshape(2, -1).sum(axis=0)
    np.testing.assert_allclose(weights, angular_weights(once), rtol=1e-4)


@pytest.mark.parametrize("lost", [2, 5])
def test_a_few_lost_projections_are_made_up_for_by_their_neighbours(lost: int) -> None:
    kept = np.delete(np.arange(180), np.arange(70, 70 + lost))
    weights = np.rad2deg(angular_weights(np.deg2rad(kept)))
    np.testing.assert_allclose(weights[[69, 70]], 1 + lost / 2, rtol=1e-9)
    np.testing.assert_allclose(np.delete(weights, [69, 70]), 1, rtol=1e-9)


@pytest.mark.parametrize(("available", "count"), [(5, 12), (12, 12), (100, 12), (13, 12)])
def test_rows_are_spread_from_the_first_to_the_last(available: int, count: int) -> None:
    some = spread(available, count)
    assert len(some) == min(available, count)
    assert (some[0], some[-1]) == (0, available - 1)


def test_what_no_scan_tells_of_shifts_is_the_axis_and_a_place_of_the_sample() -> None:
    theta = np.deg2rad(np.arange(0, 200, 1.5))
    unseen = unseen_shifts(theta)
    np.testing.assert_allclose(unseen.T @ unseen, np.eye(3), atol=1e-12)
    nobody_sees = 3 + 2 * np.cos(theta) - np.sin(theta)
    np.testing.assert_allclose(unseen @ (unseen.T @ nobody_sees), nobody_sees, atol=1e-12)
