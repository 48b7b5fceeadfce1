"""Which rows and which projections are reconstructed, and by what."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.products import Refinement, Scan
from tomoslam_stage.scans import scan_of
from tomoslam_stage.stages.reconstructing import Reconstruct, every_other


def scan_with_texture(*places: slice) -> Scan:
    """Make a scan of 96 rows that shows something at `places` only."""
    n = 12
    integrals = np.zeros((n, 96, 32), np.float32)
    for place in places:
        shape = integrals[:, place].shape
        integrals[:, place] = np.random.default_rng(3).random(shape)
    return scan_of(integrals, np.linspace(0, np.pi, n, endpoint=False))


def kept(scan: Scan) -> Refinement:
    theta, axes = scan.theta, {"recorded": 15.5, "refined": 15.5}
    return Refinement(theta, theta, np.zeros_like(theta), "kept", "", axes)


def test_every_slice_shows_something_of_an_object_in_two_separate_places() -> None:
    # The middle of these rows lies between the two, where nothing is.
    scan = scan_with_texture(slice(10, 20), slice(80, 90))
    made = Reconstruct().reconstruct(scan, kept(scan))["recorded"]
    assert made.rows.tolist() == [14, 19, 84]
    assert (np.abs(made.slices).max(axis=(1, 2)) > 0).all()


@pytest.fixture
def scan() -> Scan:
    return scan_with_texture(slice(10, 20), slice(80, 90))


def test_halves_are_made_of_every_set_of_angles(scan: Scan) -> None:
    made = Reconstruct().reconstruct(scan, kept(scan))
    names = {"recorded", "refined"}
    assert set(made) == names | {f"{name}_{half}" for name in names for half in ("even", "odd")}
    for name, one in made.items():
        assert one.method.endswith(" fbp")
        assert one.rows.tolist() == [14, 19, 84]
        assert len(one.theta) == (12 if name in names else 6)
    whole = made["recorded"].slices
    mean = (made["recorded_even"].slices + made["recorded_odd"].slices) / 2
    np.testing.assert_allclose(mean, whole, atol=1e-5 * np.abs(whole).max())


def test_of_a_slow_algorithm_only_the_middle_row_is_halved(scan: Scan) -> None:
    slow = Reconstruct(algorithm={"method": "sirt", "iterations": 2}, backend="embedded")
    made = slow.reconstruct(scan, kept(scan))
    assert made["recorded"].method == "embedded sirt"
    assert made["recorded"].rows.tolist() == [14, 19, 84]
    assert made["recorded"].convergence.shape == (2,)
    assert made["recorded_odd"].rows.tolist() == [19]
    assert made["recorded_odd"].slices.shape == (1, 32, 32)


def test_no_halves_are_made_where_nobody_wants_them_or_there_is_but_one(scan: Scan) -> None:
    made = Reconstruct(halves=False).reconstruct(scan, kept(scan))
    assert set(made) == {"recorded", "refined"}
    one = scan_of(scan.source.read(np.array([0]), np.arange(96)), np.zeros(1))
    assert set(Reconstruct().reconstruct(one, kept(one))) == {"recorded", "refined"}


@pytest.mark.parametrize(("span", "n"), [(360, 24), (360, 26), (360, 25), (180, 24), (180, 9)])
@pytest.mark.parametrize("order", ["as it turns", "interlaced", "backwards"])
def test_both_halves_go_evenly_round_the_turn(span: int, n: int, order: str) -> None:
    step = np.radians(span / n)
    place = np.arange(n) if order == "as it turns" else np.arange(n)[::-1]
    if order == "interlaced":
        place = np.concatenate([np.arange(k, n, 4) for k in range(4)])
    theta = 0.4 + step * place + np.random.default_rng(1).uniform(-0.2, 0.2, n) * step
    halves = every_other(theta)
    assert sorted(np.concatenate(halves)) == list(range(n))
    for half in halves:
        gaps = np.diff(np.sort(theta[half]))
        # Round a full turn of an odd number of projections, two of a half are neighbours.
        assert np.sum(np.abs(gaps - 2 * step) > 0.41 * step) <= (n % 2 if span == 360 else 0)
        assert (np.diff(half) > 0).all()


def test_a_turn_more_or_less_changes_no_half() -> None:
    theta = np.radians(np.arange(0, 360, 10.0))
    again = theta + 2 * np.pi * np.random.default_rng(1).integers(-2, 3, len(theta))
    for one, other in zip(every_other(theta + 0.01), every_other(again + 0.01), strict=True):
        np.testing.assert_array_equal(one, other)


def test_rows_that_are_not_there_are_refused_before_any_work(scan: Scan) -> None:
    with pytest.raises(PipelineError, match=r"reconstruct.rows: \[96\]; rows between 0 and 95"):
        Reconstruct(rows=(96,)).check_fits(scan)
    Reconstruct(rows=(0, 95)).check_fits(scan)
