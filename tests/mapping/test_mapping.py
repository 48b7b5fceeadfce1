from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.mapping import Mapped, Mapping
from tomoslam_stage.progress import heard_by

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Known

    from tomoslam_stage.products import Floats, Geometry, Integers, Quadratic, Scan, Solve

    Holding = Callable[[Floats], Solve]

ROWS = np.arange(12)
SMALL = Mapping(binning=1, rows_first=8, rows=12, probe_rows=8, steps=7)
QUICK = replace(SMALL, rows_first=6, probe_rows=6, rows=9, steps_first=1, steps=1)


def refined(scan: Scan, start: Geometry, holding: Holding, using: Mapping = SMALL) -> Mapped:
    found = using.refine(scan, ROWS, start, holding(scan.theta))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def ended(walk: Known, holding: Holding) -> Mapped:
    return refined(walk.scan, walk.recorded(), holding)


def with_values(scan: Scan, values: Floats) -> Scan:
    return replace(scan, source=type(scan.source)(values.astype(np.float32)))


def reordered(scan: Scan, order: Integers) -> Scan:
    source = type(scan.source)(values_of(scan)[order])
    return replace(scan, source=source, theta=scan.theta[order], frames=np.arange(len(order)))


def values_of(scan: Scan) -> Floats:
    return scan.source.read(np.arange(scan.n_projections), np.arange(scan.n_rows))


def test_a_walk_is_refined_many_fold(walk: Known, ended: Mapped) -> None:
    assert walk.error_deg(ended.geometry.theta) < walk.error_deg(walk.scan.theta) / 8


def test_the_axis_is_refined_along_with_the_angles(walk: Known, ended: Mapped) -> None:
    assert abs(ended.geometry.axis - walk.true.axis) < 0.02


def test_the_information_is_symmetric_and_positive(ended: Mapped) -> None:
    information = ended.quadratic.information
    assert np.array_equal(information, information.T)
    assert np.linalg.eigvalsh(information).min() > 0


def test_the_pulls_of_the_rows_add_up_to_the_whole(ended: Mapped) -> None:
    together = ended.row_pulls.sum(axis=0)
    np.testing.assert_allclose(together, ended.quadratic.pull, rtol=1e-6, atol=1e-6)
    assert ended.row_pulls.shape == (12, 92)
    assert ended.squares.shape == (12, 90)


def test_rows_scatter_as_much_as_the_angles_are_wrong(walk: Known, ended: Mapped) -> None:
    apart = ended.row_pulls[::2].sum(axis=0) - ended.row_pulls[1::2].sum(axis=0)
    half = np.linalg.solve(ended.quadratic.information, apart)[:-2]
    error = walk.error_deg(ended.geometry.theta)
    assert 0.4 * error < np.rad2deg(np.std(half)) < 2.5 * error


def test_a_scan_that_fits_the_model_has_no_excess(ended: Mapped) -> None:
    assert 1 <= ended.excess < 2


def test_projections_that_break_the_model_show_as_excess(walk: Known, holding: Holding) -> None:
    values = values_of(walk.scan).astype(float)
    values[20:23, :, ::2] += 0.5
    found = refined(with_values(walk.scan, values), walk.recorded(), holding)
    assert found.excess > 5
    others = np.delete(np.arange(90), np.arange(18, 25))
    off = (found.geometry.theta - walk.true.theta)[others]
    assert np.rad2deg(np.std(off)) < walk.error_deg(walk.scan.theta) / 4


@pytest.mark.parametrize("turn_deg", [180, 720])
def test_half_turns_and_several_turns_are_refined_too(
    making: Callable[..., Known], holding: Holding, turn_deg: float
) -> None:
    case = making(turn=np.deg2rad(turn_deg))
    found = refined(case.scan, case.recorded(), holding)
    assert case.error_deg(found.geometry.theta) < case.error_deg(case.scan.theta) / 3


@pytest.mark.parametrize(
    "order",
    [np.random.default_rng(2).permutation(90), np.append(np.arange(90), [10, 40])],
    ids=["in any order", "two of them twice"],
)
def test_projections_may_come_in_any_order_and_more_than_once(
    walk: Known, holding: Holding, order: Integers
) -> None:
    scan = reordered(walk.scan, order)
    found = refined(scan, replace(walk.recorded(), theta=scan.theta), holding)
    left = np.rad2deg(np.std(found.geometry.theta - walk.true.theta[order]))
    assert left < walk.error_deg(walk.scan.theta) / 8


def test_a_roll_of_a_tenth_of_a_degree_is_found(
    making: Callable[..., Known], holding: Holding
) -> None:
    roll = np.deg2rad(0.1)
    case = making(roll=roll, rows=100)
    rows = np.arange(2, 98)
    found = SMALL.refine(case.scan, rows, case.recorded(), holding(case.scan.theta))
    assert found is not None
    assert found.geometry.roll == pytest.approx(roll, rel=0.1)
    assert case.error_deg(found.geometry.theta) < case.error_deg(case.scan.theta) / 8


@pytest.mark.parametrize("values", [np.zeros(64), np.ones(64), np.linspace(-3, -2, 64)])
def test_a_scan_that_shows_nothing_says_nothing(
    walk: Known, holding: Holding, values: Floats
) -> None:
    scan = with_values(walk.scan, np.broadcast_to(values, (90, 12, 64)))
    assert SMALL.refine(scan, ROWS, walk.recorded(), holding(scan.theta)) is None


def test_values_that_are_no_numbers_say_nothing(walk: Known, holding: Holding) -> None:
    values = values_of(walk.scan).copy()
    values[3, 5, 7] = np.nan
    scan = with_values(walk.scan, values)
    assert SMALL.refine(scan, ROWS, walk.recorded(), holding(scan.theta)) is None


def test_angles_that_are_no_numbers_say_nothing(walk: Known, holding: Holding) -> None:
    start = replace(walk.recorded(), theta=np.append(walk.scan.theta[:-1], np.nan))
    assert SMALL.refine(walk.scan, ROWS, start, holding(walk.scan.theta)) is None


def test_a_graph_that_wants_no_change_gets_none(walk: Known) -> None:
    start = walk.recorded()
    found = QUICK.refine(walk.scan, ROWS, start, lambda *_: np.zeros(92))
    assert found is not None
    assert np.array_equal(found.geometry.theta, start.theta)
    assert np.isfinite(found.quadratic.information).all()


def test_a_change_that_is_no_number_ends_it(walk: Known) -> None:
    def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:  # noqa: ARG001
        return np.full(92, np.nan)

    assert SMALL.refine(walk.scan, ROWS, walk.recorded(), solve) is None


@pytest.mark.parametrize("rows", [0, 1, 3])
def test_too_few_rows_say_nothing(walk: Known, holding: Holding, rows: int) -> None:
    found = SMALL.refine(walk.scan, ROWS[:rows], walk.recorded(), holding(walk.scan.theta))
    assert found is None


def test_a_smooth_object_moves_no_angle_far(walk: Known, holding: Holding) -> None:
    u = np.arange(64) - walk.true.axis
    noise = np.random.default_rng(1).normal(0, 0.01, (90, 12, 64))
    scan = with_values(walk.scan, 3 * np.exp(-((u / 14) ** 2) / 2) + noise)
    found = replace(QUICK, steps=4).refine(scan, ROWS, walk.recorded(), holding(scan.theta))
    assert found is not None
    assert np.isfinite(found.quadratic.information).all()
    assert np.abs(found.geometry.theta - scan.theta).max() < np.deg2rad(5)


def test_results_do_not_depend_on_the_number_of_workers(
    walk: Known, holding: Holding, monkeypatch: pytest.MonkeyPatch
) -> None:
    several = refined(walk.scan, walk.recorded(), holding, QUICK)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    alone = refined(walk.scan, walk.recorded(), holding, QUICK)
    assert np.array_equal(several.geometry.theta, alone.geometry.theta)
    assert np.array_equal(several.row_pulls, alone.row_pulls)


def test_the_listener_hears_how_far_it_is(walk: Known, holding: Holding) -> None:
    heard: list[tuple[str, int, int]] = []
    with heard_by(lambda *said: heard.append(said)):
        refined(walk.scan, walk.recorded(), holding, QUICK)
    assert {what for what, _, _ in heard} == {"mapping"}
    totals = {total for _, _, total in heard}
    assert [done for _, done, _ in heard] == list(range(1, totals.pop() + 1))
