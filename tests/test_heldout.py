from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.heldout import hold_out, textured
from tomoslam_stage.products import Floats, Scan
from tomoslam_stage.scans.sources import ArraySource

COLUMNS = 160


def scan_of(rows: Floats, n: int = 12, shown: slice = slice(None)) -> Scan:
    """Return a scan whose `rows` show so much fine detail in the projections `shown`."""
    detail = np.random.default_rng(1).normal(size=(n, len(rows), COLUMNS))
    strength = np.zeros((n, 1, 1))
    strength[shown] = 1
    stack = (strength * detail * np.asarray(rows)[:, None]).astype(np.float32)
    return Scan(ArraySource(stack), np.linspace(0, np.pi, n), np.arange(n))


def test_rows_held_out_lie_in_each_fifth_of_where_something_is_to_be_seen() -> None:
    rows = np.zeros(240)
    rows[60:180] = 1
    heldout = hold_out(scan_of(rows)).heldout
    middles = 71, 95, 119, 143, 167
    assert heldout.tolist() == [m + k for m in middles for k in (-1, 0, 1)]


def test_rows_held_out_follow_texture_in_separate_places() -> None:
    rows = np.zeros(240)
    rows[10:30] = rows[200:220] = 1
    heldout = hold_out(scan_of(rows)).heldout
    middles = 13, 21, 29, 207, 215
    assert heldout.tolist() == [m + k for m in middles for k in (-1, 0, 1)]


@pytest.mark.parametrize(
    ("n_rows", "heldout", "lost"),
    [
        (1, [0], [0]),
        (2, [0], [0]),
        (5, [1, 3], [1, 3]),
        (30, [7, 21], [7, 21]),
        (40, [9, 29], [8, 9, 10, 28, 29, 30]),
        (80, [7, 23, 39, 55, 71], [m + k for m in range(7, 80, 16) for k in range(-2, 3)]),
    ],
)
def test_small_detectors_hold_out_single_rows(
    n_rows: int, heldout: list[int], lost: list[int]
) -> None:
    rows = hold_out(scan_of(np.ones(n_rows)))
    assert rows.heldout.tolist() == heldout
    assert np.flatnonzero(~rows.usable).tolist() == lost


@pytest.mark.parametrize(
    ("n_rows", "bands"), [(16, 2), (47, 2), (48, 3), (63, 3), (64, 4), (79, 4), (80, 5), (600, 5)]
)
def test_there_is_a_band_for_each_sixteen_rows_from_two_to_five(n_rows: int, bands: int) -> None:
    heldout = hold_out(scan_of(np.ones(n_rows), n=2)).heldout
    assert 1 + np.count_nonzero(np.diff(heldout) > 1) == bands


@pytest.mark.parametrize("n_rows", [20, 30, 48, 79, 80, 81, 120, 161, 240, 600])
def test_a_tenth_of_the_rows_judges_at_most_and_two_thirds_are_left(n_rows: int) -> None:
    rows = hold_out(scan_of(np.ones(n_rows), n=2))
    assert len(rows.heldout) <= n_rows / 10
    assert rows.usable.sum() > 2 / 3 * n_rows
    assert not rows.usable[rows.heldout].any()


def test_wide_bands_have_three_unused_rows_on_either_side() -> None:
    rows = hold_out(scan_of(np.ones(240)))
    first = rows.heldout[:3]
    assert np.diff(first).tolist() == [1, 1]
    beside = rows.usable[first[0] - 4 : first[2] + 5]
    assert beside.tolist() == [True, *[False] * 9, True]


@pytest.mark.parametrize("n_rows", [40, 160, 239, 240, 241, 480])
@pytest.mark.parametrize("upper", [True, False])
def test_bands_stay_on_the_detector_though_only_its_edge_shows_something(
    n_rows: int, upper: bool
) -> None:
    edge = n_rows // 10 + 1
    rows = np.zeros(n_rows)
    rows[slice(edge) if upper else slice(-edge, None)] = 1
    heldout = hold_out(scan_of(rows, n=2)).heldout
    assert heldout.min() >= 0
    assert heldout.max() < n_rows
    assert len(heldout) == min(5, n_rows // 16) * min(3, max(1, n_rows // 80))


def test_a_scan_that_shows_nothing_has_rows_to_judge_by_all_the_same() -> None:
    rows = hold_out(scan_of(np.zeros(120)))
    assert rows.heldout.tolist() == [11, 35, 59, 83, 107]


def test_rows_are_textured_from_a_tenth_of_the_detail_of_the_liveliest() -> None:
    rows = np.ones(40)
    rows[:3] = 0, np.sqrt(0.06), np.sqrt(0.16)
    assert textured(scan_of(rows)).tolist() == [False, False, *[True] * 38]


def test_one_very_lively_row_does_not_make_the_others_dull() -> None:
    rows = np.ones(40)
    rows[7] = 100
    assert textured(scan_of(rows)).all()


def test_what_is_smooth_along_the_columns_is_no_texture() -> None:
    scan = scan_of(np.r_[np.zeros(10), np.full(30, 0.1)])
    stack = scan.source.read(np.arange(12), np.arange(40))
    stack[:, :10] = 20 + 0.3 * np.cos(2 * np.pi * np.arange(COLUMNS) / COLUMNS)
    assert stack[0, 0].std() > 2 * stack[0, 20].std()
    found = textured(Scan(ArraySource(stack), scan.theta, scan.frames))
    assert found.tolist() == [False] * 10 + [True] * 30


@pytest.mark.parametrize("shown", [0, 6, 11])
def test_texture_is_looked_for_from_the_first_to_the_last_projection(shown: int) -> None:
    rows = np.r_[np.zeros(20), np.ones(20)]
    found = textured(scan_of(rows, n=12, shown=slice(shown, shown + 1)))
    assert found.tolist() == [False] * 20 + [True] * 20
