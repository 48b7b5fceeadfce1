from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.images import highpass
from tomoslam_stage.reprojection import Reprojection, binned, lowest
from tomoslam_stage.simulation import recipe_from, simulate

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels

COLUMNS = 96


def grains(span_deg: float, axis_offset: float) -> tuple[Pixels, Floats, float]:
    """(2, n, column) noisy sinograms of grains, their true angles and their axis."""
    recipe = {
        "phantom": {"method": "grains", "grains": 300},
        "n_projections": 90 if span_deg == 180 else 120,
        "span_deg": span_deg,
        "rows": 24,
        "columns": COLUMNS,
        "axis_offset": axis_offset,
        "angle_errors": [],
    }
    scan = simulate(recipe_from(recipe))
    projections = [scan.line_integrals(k)[[10, 12]] for k in range(scan.shape[0])]
    sinograms = np.stack(projections, axis=1)
    sinograms += np.random.default_rng(4).normal(0, 0.01, sinograms.shape)
    return sinograms.astype(np.float32), scan.theta_true, scan.axis


@pytest.fixture(scope="module")
def sinograms() -> tuple[Pixels, Floats, float]:
    return grains(360.0, 6.0)


def judged(sinograms: Pixels, theta: Floats, axis: float) -> float:
    return float(Reprojection().squares(sinograms, theta, axis).mean())


@pytest.mark.parametrize("kind", ["jitter", "walk", "warp"])
def test_less_is_left_the_nearer_the_angles_are_to_the_true_ones(
    sinograms: tuple[Pixels, Floats, float], kind: str
) -> None:
    recorded, theta, axis = sinograms
    noise = np.random.default_rng(0).normal(size=len(theta))
    error = {"jitter": noise, "walk": np.cumsum(noise) / 4, "warp": 2 * np.sin(3 * theta)}[kind]
    left = [judged(recorded, theta + np.deg2rad(s) * error, axis) for s in (0, 0.5, 1, 2)]
    assert left == sorted(left)
    assert left[2] > 1.1 * left[0]


def test_a_common_turn_of_all_angles_leaves_as_much(
    sinograms: tuple[Pixels, Floats, float],
) -> None:
    recorded, theta, axis = sinograms
    turned = judged(recorded, theta + 0.7, axis)
    assert turned == pytest.approx(judged(recorded, theta, axis), rel=0.02)


def test_least_is_left_at_the_true_axis(sinograms: tuple[Pixels, Floats, float]) -> None:
    recorded, theta, axis = sinograms
    left = {off: judged(recorded, theta, axis + off) for off in (-2, -0.5, 0, 0.5, 2)}
    assert min(left, key=left.__getitem__) == 0
    assert left[-2] > left[-0.5]
    assert left[2] > left[0.5]


def test_the_projection_with_a_wrong_angle_is_the_one_that_leaves_most(dots: Blobs) -> None:
    theta = np.arange(120) * np.pi / 120
    wrong = theta.copy()
    wrong[47] += np.deg2rad(4)
    squares = Reprojection().squares(dots.sinograms(wrong, 47.5, COLUMNS), theta, 47.5)
    assert squares.shape == (2, 120)
    assert squares.dtype == np.float64
    assert squares.argmax(axis=1).tolist() == [47, 47]
    assert squares[0, 47] > 5 * np.median(squares[0])


def test_nearly_nothing_of_a_faultless_scan_is_left(dots: Blobs) -> None:
    theta = np.arange(240) * np.pi / 240
    recorded = dots.sinograms(theta, 50.2, 104)
    left = np.sqrt(judged(recorded, theta, 50.2))
    assert left < 0.06 * recorded.std()


def test_attenuation_below_zero_explains_nothing(dots: Blobs) -> None:
    theta = np.arange(60) * np.pi / 60
    below = -dots.sinograms(theta, 47.5, COLUMNS)
    unexplained = np.mean(highpass(below, 8.0) ** 2)
    assert judged(below, theta, 47.5) > 0.7 * unexplained
    assert judged(-below, theta, 47.5) < 0.1 * unexplained


def test_what_lies_where_not_every_projection_looks_explains_nothing(dots: Blobs) -> None:
    theta = np.arange(60) * np.pi / 60
    aside = replace(dots, x=np.full(60, 37.0), z=np.full(60, 37.0))
    sinograms = aside.sinograms(theta, 47.5, COLUMNS)
    unexplained = np.mean(highpass(sinograms, 8.0) ** 2)
    assert judged(sinograms, theta, 47.5) > 0.7 * unexplained


def test_what_drifts_smoothly_along_the_columns_does_not_count(dots: Blobs) -> None:
    theta = np.arange(120) * np.pi / 120
    recorded = dots.sinograms(theta, 47.5, COLUMNS)
    drift = np.random.default_rng(6).normal(0, 0.1, (1, 120, 1)) * np.linspace(0.5, 1, COLUMNS)
    drifting = (recorded + drift).astype(np.float32)
    added = judged(drifting, theta, 47.5) - judged(recorded, theta, 47.5)
    assert abs(added) < 0.1 * np.mean(drift**2)
    counted = Reprojection(cutoff=1000.0)
    all_of_it = counted.squares(drifting, theta, 47.5) - counted.squares(recorded, theta, 47.5)
    assert all_of_it.mean() > 2 * abs(added)


def test_what_is_left_is_the_same_for_any_number_of_cores(
    sinograms: tuple[Pixels, Floats, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded, theta, axis = sinograms
    many = np.concatenate([recorded, 0.5 * recorded, recorded[::-1], recorded, recorded[:1]])

    def squares(cores: int | None) -> Floats:
        monkeypatch.setattr(os, "cpu_count", lambda: cores)
        return Reprojection().squares(many, theta, axis)

    one = squares(1)
    assert one.shape == (9, len(theta))
    for cores in (2, 7, None):
        np.testing.assert_array_equal(squares(cores), one)
    np.testing.assert_allclose(one[2:4], one[:2] / 4, rtol=1e-3)
    np.testing.assert_allclose(one[4:6], one[1::-1], rtol=1e-3)
    np.testing.assert_allclose(one[8], one[0], rtol=1e-3)


@pytest.mark.parametrize("span_deg", [180.0, 360.0])
@pytest.mark.parametrize("offset", [0.0, 10.0, -10.3])
def test_the_axis_is_found_from_scratch_in_noise(span_deg: float, offset: float) -> None:
    sinograms, theta, axis = grains(span_deg, offset)
    found = Reprojection().find_axis(sinograms, theta)
    assert found == pytest.approx(axis, abs=0.05)


def test_the_axis_of_a_wide_detector_is_found_first_on_binned_columns(
    dots: Blobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    theta, columns, axis = np.arange(361) * np.pi / 361, 289, 163.5
    sinograms = dots.sinograms(theta, axis, columns)[:1]
    assert Reprojection().find_axis(sinograms, theta) == pytest.approx(axis, abs=0.01)

    starts: list[tuple[float, float]] = []

    def note(_: Reprojection, sinograms: Pixels, theta: Floats, start: float, step: float) -> float:
        assert sinograms.shape == (1, len(theta), columns)
        starts.append((start, step))
        return start

    monkeypatch.setattr(Reprojection, "best_axis", note)
    Reprojection().find_axis(sinograms, theta)
    assert starts == [(axis, 2)]


def test_the_axis_is_looked_for_only_within_reach(dots: Blobs) -> None:
    theta = np.arange(90) * np.pi / 90
    sinograms = dots.sinograms(theta, 62.0, COLUMNS)[:1]
    asked: list[float] = []

    class Watched(Reprojection):
        def squares(self, sinograms: Pixels, theta: Floats, axis: float) -> Floats:
            asked.append(axis)
            return super().squares(sinograms, theta, axis)

    Watched(axis_reach=0.05).find_axis(sinograms, theta)
    assert asked[:9] == [47.5 + k for k in range(-4, 5)]
    assert asked[9] == 51.5, "the walk starts where the grid was lowest, at its end"


def test_an_axis_is_given_even_where_there_is_nothing_to_see() -> None:
    nothing = np.zeros((2, 30, 40), np.float32)
    found = Reprojection().find_axis(nothing, np.arange(30) * np.pi / 30)
    assert 19.5 - 8 <= found <= 19.5 + 8


@pytest.mark.parametrize("lowest_at", [-7.3, 0.0, 0.04, 2.71])
@pytest.mark.parametrize("step", [0.2, 0.5, 1.0, 4.0])
def test_lowest_finds_the_bottom_of_a_parabola(lowest_at: float, step: float) -> None:
    found = lowest(lambda x: 3 + 2 * (x - lowest_at) ** 2, 0.0, step)
    assert found == pytest.approx(lowest_at, abs=1e-9)


@pytest.mark.parametrize("lowest_at", [-7.3, 0.0, 0.04, 2.71])
def test_lowest_finds_the_bottom_of_a_kink(lowest_at: float) -> None:
    assert lowest(lambda x: abs(x - lowest_at), 0.0, 1.0) == pytest.approx(lowest_at, abs=0.04)


@pytest.mark.parametrize("level", [0.0, np.nan, np.inf])
def test_lowest_stays_on_a_plain(level: float) -> None:
    assert lowest(lambda _: level, 5.0, 1.0) == 5.0


def test_lowest_never_asks_twice() -> None:
    asked: list[float] = []

    def bowl(x: float) -> float:
        asked.append(x)
        return (x - 3) ** 4

    found = lowest(bowl, 0.0, 1.0)
    assert found == pytest.approx(3)
    assert len(asked) == len(set(asked)) < 20


@pytest.fixture
def wide() -> Callable[[int], Pixels]:
    return lambda columns: np.arange(2.0 * columns, dtype=np.float32).reshape(1, 2, columns)


def test_binned_columns_are_means_and_what_is_left_over_is_dropped(
    wide: Callable[[int], Pixels],
) -> None:
    assert binned(wide(8), 3).tolist() == [[[1, 4], [9, 12]]]
    np.testing.assert_array_equal(binned(wide(5), 1), wide(5))
