"""What refined angles tell about the rotation stage."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.products import Floats
from tomoslam_stage.refinement import lapses, stage_noise
from tomoslam_stage.refinement.stage_noise import LEAST_DEG

N = 360
STEPS = np.diff(np.eye(N), axis=0)
RECORDED = np.deg2rad(np.arange(N, dtype=float))
UNSURE = np.deg2rad(0.02) ** 2 * np.eye(N)
"""Covariance of angles that are measured to 0.02 degrees, each on its own."""
UNSURE_STEPS = np.full(N - 1, 2 * np.deg2rad(0.02) ** 2)
"""Variances of the steps between such angles."""


def errors(walk: float, jitter: float, seed: int) -> Floats:
    """(n,) radians: errors of a stage with a walk and a jitter of so many degrees."""
    rng = np.random.default_rng(seed)
    return np.deg2rad(np.cumsum(rng.normal(0, walk, N)) + rng.normal(0, jitter, N))


def told(true: Floats, walk: float, jitter: float) -> tuple[Floats, Floats]:
    """What is made of `true` errors where they are measured with `UNSURE`; variances of its steps.

    The posterior, for a stage that is known to have a walk and a jitter of so many degrees.
    """
    gap = np.minimum.outer(np.arange(N), np.arange(N)) + 1
    prior = np.deg2rad(walk) ** 2 * gap + np.deg2rad(jitter) ** 2 * np.eye(N)
    gain = prior @ np.linalg.inv(prior + UNSURE)
    noise = np.random.default_rng(99).normal(0, np.sqrt(UNSURE[0, 0]), N)
    return gain @ (true + noise), np.diag(STEPS @ (prior - gain @ prior) @ STEPS.T)


def measured(true: Floats, seed: int = 99) -> tuple[Floats, Floats]:
    """What measurements make of `true` errors without any belief, and what their halves show."""
    rng = np.random.default_rng(seed)
    noise, halves = rng.normal(0, np.sqrt(UNSURE[0, 0]), (2, N))
    return true + noise, halves[None]


@pytest.mark.parametrize(("walk", "jitter"), [(0.05, 0.0), (0.0, 0.05), (0.06, 0.04), (0.03, 0.1)])
def test_walk_and_jitter_are_told_from_each_other(walk: float, jitter: float) -> None:
    found = [stage_noise(RECORDED, *measured(errors(walk, jitter, s), s + 50)) for s in range(6)]
    walks, jitters = (np.rad2deg([getattr(f, name) for f in found]) for name in ("walk", "jitter"))
    # Variances are what adds up; either steals from the other no more than what is left of it.
    step = walk**2 + 2 * jitter**2
    assert np.mean(walks**2) == pytest.approx(walk**2, abs=0.15 * step)
    assert np.mean(jitters**2) == pytest.approx(jitter**2, abs=0.1 * step)
    assert np.rad2deg(np.mean([f.step for f in found])) == pytest.approx(np.sqrt(step), rel=0.1)


def test_angles_that_are_measured_badly_tell_less_about_the_stage() -> None:
    badly = np.where(np.abs(np.arange(N) - N // 2) < 30, 0.3, 0.005)
    found = []
    for seed in range(6):
        noise, halves = np.deg2rad(badly * np.random.default_rng(seed).standard_normal((2, N)))
        found.append(stage_noise(RECORDED, errors(0.0, 0.1, seed) + noise, halves[None]))
    assert np.rad2deg(np.mean([f.jitter for f in found])) == pytest.approx(0.1, rel=0.05)
    assert np.rad2deg(np.mean([f.walk for f in found])) < 0.02


def test_the_walk_is_that_of_a_step_where_the_stage_made_several_in_between() -> None:
    found = [
        stage_noise(RECORDED, *measured(errors(0.05, 0.0, s)), stage_steps=4.0) for s in range(6)
    ]
    assert np.rad2deg(np.mean([f.walk for f in found])) == pytest.approx(0.025, rel=0.1)


def test_each_step_counts_for_as_many_as_the_stage_made() -> None:
    made = np.where(np.arange(N - 1) % 10 == 0, 16.0, 1.0)
    found = []
    for seed in range(6):
        walk = np.deg2rad(0.03) * np.sqrt(made) * np.random.default_rng(seed).standard_normal(N - 1)
        found.append(stage_noise(RECORDED, np.append(0, np.cumsum(walk)), np.zeros((1, N)), made))
    assert np.rad2deg(np.mean([f.walk for f in found])) == pytest.approx(0.03, rel=0.1)


def test_errors_of_the_measurement_are_not_blamed_on_the_stage() -> None:
    found = [stage_noise(RECORDED, *measured(np.zeros(N), s)) for s in range(6)]
    exact = np.zeros((1, N))
    blamed = np.rad2deg(
        [stage_noise(RECORDED, measured(np.zeros(N), s)[0], exact).step for s in (0, 1)]
    )
    assert np.rad2deg(np.mean([f.step for f in found])) < 0.01
    assert blamed == pytest.approx(0.02 * np.sqrt(2), rel=0.1)


def test_a_lost_step_hardly_counts_as_noise() -> None:
    true = errors(0.05, 0.0, seed=3)
    lost = true + np.deg2rad(2.0) * (np.arange(N) >= 100)
    usual, disturbed = (stage_noise(RECORDED, *measured(e)).walk for e in (true, lost))
    assert disturbed == pytest.approx(usual, rel=0.1)


def test_no_stage_is_taken_for_perfect() -> None:
    noise = stage_noise(RECORDED, np.zeros(N), np.zeros((1, N)))
    assert np.rad2deg(noise.step) == pytest.approx(LEAST_DEG)


@pytest.mark.parametrize(("walk", "jitter"), [(0.05, 0.0), (0.0, 0.1), (0.2, 0.0), (0.0, 0.0)])
def test_nothing_is_named_where_there_is_noise_alone(walk: float, jitter: float) -> None:
    found = [lapses(RECORDED, *told(errors(walk, jitter, s), walk, jitter)) for s in range(10)]
    assert found == [()] * 10


def test_a_lost_step_is_named_with_its_projection_size_and_significance() -> None:
    true = errors(0.03, 0.0, seed=1) - np.deg2rad(0.6) * (np.arange(N) >= 200)
    found, variances = told(true, 0.5, 0.0)
    (event,) = lapses(RECORDED, found, variances)
    assert event.projection == 200
    assert event.size_deg == pytest.approx(np.rad2deg(np.diff(true)[199]), abs=3 * 0.03)
    # The noise of a step: the walk, and what the measurement of two angles adds (twice).
    assert 6 <= event.significance == pytest.approx(0.6 / np.hypot(0.03, 2 * 0.02), rel=0.4)
    assert event.kind == "lost step"


@pytest.mark.parametrize(
    ("size", "kind"),
    [
        (1.0, "dropped frame"),
        (1.1, "dropped frame"),
        (-1.0, "duplicated frame"),
        (-0.9, "duplicated frame"),
        (1.3, "lost step"),
        (-0.6, "lost step"),
        (-2.0, "lost step"),
    ],
)
@pytest.mark.parametrize("turns", [1, -1])
def test_a_lapse_of_a_whole_step_is_a_matter_of_frames(size: float, kind: str, turns: int) -> None:
    lapse = turns * np.deg2rad(size) * (np.arange(N) >= 50)
    (event,) = lapses(turns * RECORDED, lapse, UNSURE_STEPS / 100)
    assert (event.projection, event.kind) == (50, kind)
    assert event.size_deg == pytest.approx(turns * size)


def test_a_lapse_where_the_stage_turns_round_is_backlash() -> None:
    there = np.deg2rad(np.concatenate([np.arange(180.0), np.arange(178.0, -2, -1)]))
    lapse = np.deg2rad(0.4) * (np.arange(N) >= 180)
    (event,) = lapses(there, lapse, UNSURE_STEPS / 100)
    assert (event.projection, event.kind) == (180, "backlash")


def test_the_first_and_the_last_step_may_be_lost() -> None:
    lapse = np.deg2rad(0.5) * (np.arange(N) >= 1) + np.deg2rad(0.3) * (np.arange(N) >= N - 1)
    first, last = lapses(RECORDED, lapse, UNSURE_STEPS / 100)
    assert (first.projection, last.projection) == (1, N - 1)
    assert {first.kind, last.kind} == {"lost step"}


def test_lapses_are_named_in_order() -> None:
    lapse = sum(np.deg2rad(0.7) * (np.arange(N) >= k) for k in (250, 40, 111))
    assert [e.projection for e in lapses(RECORDED, lapse, UNSURE_STEPS / 100)] == [40, 111, 250]


def test_what_no_step_is_sure_to_have_is_not_named() -> None:
    lapse = np.deg2rad(0.6) * (np.arange(N) >= 200)
    assert not lapses(RECORDED, lapse, 50 * UNSURE_STEPS)


def test_what_is_smaller_than_any_event_is_not_named_however_sure() -> None:
    lapse = np.deg2rad(0.09) * (np.arange(N) >= 200)
    assert not lapses(RECORDED, lapse, np.zeros(N - 1))


def test_many_steps_of_a_walk_between_two_projections_are_no_lapse() -> None:
    steps = np.ones(N - 1)
    steps[119] = 100
    walk = np.deg2rad(0.05) * np.random.default_rng(1).standard_normal(N - 1)
    walk[119] = np.deg2rad(0.05 * 10)
    error = np.append(0, np.cumsum(walk))
    assert [e.projection for e in lapses(RECORDED, error, UNSURE_STEPS / 100)] == [120]
    assert not lapses(RECORDED, error, UNSURE_STEPS / 100, steps)
