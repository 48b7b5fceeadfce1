"""The paper's equation 2 and its RANSAC."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.angles.ransac import Ransac, k_of_pairs, steps_of_pair

STEPS = [(4, 4), (5, 5), (10, 10), (40, 40), (4, 7), (12, 5), (31, 42), (1, 1)]


def seen(columns, steps: tuple[float, float], start: float = 0.7, **features: int) -> np.ndarray:
    """(t, 3) columns in three projections that lie `steps` degrees apart."""
    turns = np.deg2rad([0, steps[0], sum(steps)])
    return columns(start + turns, **{"count": 200, "seed": 3} | features)


def printed_formula(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Equation 2 letter by letter, with 1 for the misprinted subscript 0."""
    (x1, x2, x3), (y1, y2, y3) = one.T, other.T
    k = (x3 * y1 - x1 * y3) / (x2 * y1 - x1 * y2)
    cosine = ((1 - k**2) * x1**2 - (x3 - k * x2) ** 2) / (2 * k * x1 * (x3 - k * x2))
    first = np.arccos(cosine)
    return np.stack([first, np.arcsin(k * np.sin(first)) - first], axis=-1)


@pytest.mark.parametrize("steps", STEPS)
def test_closed_form_is_exact_on_pairs_without_error(columns, steps: tuple[float, float]) -> None:
    tracks = seen(columns, steps)
    found = np.rad2deg(steps_of_pair(tracks[:100], tracks[100:]))
    np.testing.assert_allclose(found, np.broadcast_to(steps, (100, 2)), atol=1e-4)


def test_negative_steps_give_the_same_sizes(columns) -> None:
    tracks = seen(columns, (-4, -9))
    found = np.rad2deg(steps_of_pair(tracks[:100], tracks[100:]))
    np.testing.assert_allclose(found, np.broadcast_to([4, 9], (100, 2)), atol=1e-5)


@pytest.mark.parametrize("steps", [step for step in STEPS if sum(step) < 90])
def test_closed_form_is_the_papers_formula(columns, steps: tuple[float, float]) -> None:
    tracks = seen(columns, steps) + np.random.default_rng(0).normal(0, 0.3, (200, 3))
    one, other = tracks[:100], tracks[100:]
    ours = steps_of_pair(one, other)
    with np.errstate(invalid="ignore"):
        printed = printed_formula(one, other)
    # The paper's arcsine knows only steps that add up to less than a quarter turn.
    valid = np.isfinite(printed).all(axis=1) & (ours.sum(axis=1) < np.pi / 2)
    assert valid.sum() > 30
    np.testing.assert_allclose(ours[valid], printed[valid], atol=1e-6)


def test_k_is_that_of_the_steps(columns) -> None:
    tracks = seen(columns, (6, 11))
    k = np.sin(np.deg2rad(17)) / np.sin(np.deg2rad(6))
    np.testing.assert_allclose(k_of_pairs(tracks[:100], tracks[100:]), k, rtol=1e-6)


def test_pairs_on_one_line_through_the_axis_have_no_k(columns) -> None:
    track = seen(columns, (5, 5))[:4]
    assert np.isnan(k_of_pairs(track, 2 * track)).all()
    assert np.isnan(steps_of_pair(track, 2 * track)).all()
    assert np.isnan(steps_of_pair(np.zeros((1, 3)), track[:1])).all()


@pytest.mark.parametrize(
    ("probability", "reliable", "trials"),
    [(0.99, 0.5, 17), (0.999, 0.4, 40), (0.999, 0.9, 5), (0.5, 0.7, 2)],
)
def test_number_of_trials_comes_from_the_wanted_probability(
    probability: float, reliable: float, trials: int
) -> None:
    assert Ransac(probability=probability, reliable=reliable).trials == trials
    missed = (1 - reliable**2) ** trials
    assert missed <= 1 - probability < missed / (1 - reliable**2)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("steps", [(4, 4), (10, 10), (40, 40), (5, 8)])
def test_consensus_survives_two_wrong_tracks_in_five(
    columns, steps: tuple[float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    tracks = seen(columns, steps, count=100, seed=seed) + rng.normal(0, 0.05, (100, 3))
    wrong = rng.permutation(100) < 40
    tracks[wrong, 2] += rng.choice([-1, 1], 40) * rng.uniform(20, 60, 40)
    pair, chosen = Ransac(k_tolerance=0.1).consensus(tracks, seed)
    assert not wrong[pair].any()
    assert chosen[pair].all()
    assert chosen[wrong].mean() < 0.25
    # Tracks that make a poorly conditioned pair with one of those drawn may be missing.
    assert chosen[~wrong].mean() > 0.6


def test_false_tracks_that_agree_lose_against_more_true_ones(columns) -> None:
    tracks = np.concatenate(
        [seen(columns, (5, 5), count=60), seen(columns, (5, 9), count=40, seed=8)]
    )
    _, chosen = Ransac(k_tolerance=0.05).consensus(tracks, 0)
    assert chosen[:60].all()
    assert chosen[60:].mean() < 0.3


def test_a_pair_alone_agrees_with_itself() -> None:
    tracks = np.random.default_rng(4).normal(0, 50, (9, 3))
    _, chosen = Ransac(k_tolerance=1e-9).consensus(tracks, 0)
    assert chosen.sum() == 2


def test_the_same_seed_draws_the_same_pairs(columns) -> None:
    tracks = seen(columns, (5, 5), count=30) + np.random.default_rng(0).normal(0, 2, (30, 3))
    again = [Ransac().consensus(tracks, 7)[1] for _ in range(2)]
    np.testing.assert_array_equal(*again)
