"""What is said about measured steps follows from them."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage.studies import Case
from tomoslam_stage.studies.cv import OURS, PAPER, WAYS, Measured, measured, steps_of
from tomoslam_stage.studies.histograms import histogram, shape_of
from tomoslam_stage.studies.step_size import biased, conclusion, finest, usable


def seen(steps_deg: tuple[float, float], count: int, scatter: float = 0.0) -> np.ndarray:
    """(count, 3) px: columns of features in a triplet."""
    rng = np.random.default_rng(4)
    theta = np.deg2rad([0, steps_deg[0], sum(steps_deg)])
    radius, phase = 100 * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    columns = radius[:, None] * np.cos(theta + phase[:, None])
    return columns + rng.normal(0, scatter, columns.shape)


def errors_of(step: float, sigma: float, median: float = 0.0, count: int = 300) -> Measured:
    """Return as many triplets with normally distributed errors."""
    errors = np.random.default_rng(int(step)).normal(0, sigma, (count, 2))
    errors += median - np.median(errors)
    return Measured(step, 360, np.full(360, 20.0), step + errors, errors)


@pytest.mark.parametrize("steps", [(4.0, 4.0), (10.0, 10.0), (30.0, 25.0)])
def test_both_estimators_find_exact_steps(steps: tuple[float, float]) -> None:
    minimal, every = steps_of(seen(steps, 40))
    np.testing.assert_allclose(np.rad2deg(minimal), steps, atol=1e-5)
    np.testing.assert_allclose(np.rad2deg(every), steps, atol=1e-5)


def test_all_inliers_measure_better_than_the_minimal_sample() -> None:
    found = np.rad2deg([steps_of(seen((10.0, 10.0), n, 0.1)) for n in range(40, 100)])
    minimal, every = np.sqrt(np.nanmean((found - 10) ** 2, axis=(0, 2)))
    assert every < 0.7 * minimal


def test_a_step_that_the_scan_is_too_short_for_has_no_triplets(tmp_path: Path) -> None:
    theta = np.deg2rad(np.arange(20.0))
    noise = np.random.default_rng(0).normal(size=(20, 40, 50)).astype(np.float32)
    path = tmp_path / "short.h5"
    with h5py.File(path, "w") as file:
        file["exchange/data"] = noise
        file["exchange/theta"] = np.rad2deg(theta)
    case = Case(path, tmp_path, "short", {})
    found = measured(case, OURS, 15.0)
    assert (found.possible, len(found.steps), found.typical_tracks) == (0, 0, 0)
    assert np.isnan(found.sigma)
    assert np.isnan(found.row(OURS)["median_deg"])


def test_nothing_is_measured_from_too_few_tracks() -> None:
    assert np.isnan(steps_of(seen((5.0, 5.0), 5))).all()
    assert np.isnan(steps_of(np.empty((0, 3)))).all()


def test_steps_with_larger_errors_or_fewer_triplets_are_not_usable() -> None:
    several = [errors_of(1, 5), errors_of(4, 0.3), errors_of(10, 0.2), errors_of(40, 0.2, count=90)]
    assert usable(several) == [4, 10]
    assert finest([*several, errors_of(20, 9)]) == [1, 4, 10, 40]
    assert usable([Measured(4, 360, np.zeros(360), np.empty((0, 2)), np.empty((0, 2)))]) == []


def test_a_median_off_zero_is_a_bias_only_where_it_is_significant() -> None:
    assert biased([errors_of(7, 0.2, 0.1), errors_of(10, 0.2, 0.001)]) == [7]


def test_the_conclusion_agrees_with_the_paper_where_the_numbers_do() -> None:
    sigmas = {1.0: 2.0, 4.0: 0.2, 5.0: 0.2, 7.0: 0.2, 10.0: 0.2, 20.0: 0.9}
    published = [errors_of(step, sigma, 0.1 * (step == 7)) for step, sigma in sigmas.items()]
    said = conclusion(dict.fromkeys(WAYS, published))
    assert f"{PAPER} (the paper's way): usable steps 4, 5, 7 and 10 degrees (as published)" in said
    assert "more than 4, 5 and 10 holds" in said
    other = [errors_of(step, sigma) for step, sigma in (sigmas | {4.0: 1.0}).items()]
    said = conclusion(dict.fromkeys(WAYS, other))
    assert "usable steps 5, 7 and 10 degrees (published 4, 5, 7 and 10)" in said
    assert "does not hold" in said


def test_the_conclusion_says_where_nothing_was_measured() -> None:
    none = Measured(10, 360, np.zeros(360), np.empty((0, 2)), np.empty((0, 2)))
    assert "No triplet could be measured" in conclusion({PAPER: [none], OURS: [none]})


def test_normal_errors_pass_the_test_and_heavy_tails_do_not() -> None:
    random = np.random.default_rng(2)
    normal = shape_of(random.normal(10, 0.2, 400))
    assert normal.verdict == "normal"
    assert normal.sigma_from_quartiles == pytest.approx(0.2, rel=0.1)
    assert normal.outside < 0.02
    heavy = shape_of(10 + 0.2 * random.standard_t(2, 400))
    assert heavy.verdict == "not normal"
    assert heavy.outside > 0.04
    assert shape_of(np.ones(5)).verdict == "too few to tell"


def test_a_histogram_counts_what_lies_near_and_draws_the_normal_there() -> None:
    values = np.append(np.random.default_rng(3).normal(10, 0.2, 300), [50.0, -20.0])
    made = histogram("steps", values)
    assert 290 < made.counts.sum() <= 300
    assert made.normal is not None
    middles = (made.edges[1:] + made.edges[:-1]) / 2
    assert middles[np.argmax(made.normal)] == pytest.approx(np.median(values), abs=0.03)
    assert made.normal.sum() == pytest.approx(302, rel=0.01)
