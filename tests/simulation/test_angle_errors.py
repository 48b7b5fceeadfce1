from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.simulation.angle_errors import (
    ANGLE_ERRORS,
    Eccentric,
    EncoderWalk,
    Jitter,
    LostStep,
)

N = 4000
NOMINAL = np.deg2rad(np.linspace(0, 360, N, endpoint=False))


def errors_deg(error: object, seed: int = 0) -> np.ndarray:
    disturbed = error.disturb(NOMINAL, np.random.default_rng(seed))
    return np.rad2deg(disturbed - NOMINAL)


def test_walk_errs_by_its_sigma_at_every_step_and_starts_exact() -> None:
    error = errors_deg(EncoderWalk(sigma_deg=0.05))
    assert error[0] == 0
    steps = np.diff(error)
    assert steps.std() == pytest.approx(0.05, rel=0.05)
    assert abs(np.corrcoef(steps[1:], steps[:-1])[0, 1]) < 0.05


def test_walk_spreads_with_the_root_of_the_number_of_steps() -> None:
    ends = [errors_deg(EncoderWalk(sigma_deg=0.05), seed)[-1] for seed in range(200)]
    assert np.std(ends) == pytest.approx(0.05 * np.sqrt(N - 1), rel=0.2)


def test_jitter_is_independent_from_angle_to_angle() -> None:
    error = errors_deg(Jitter(sigma_deg=0.1))
    assert error.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05


def test_stage_lags_from_the_lost_step_on() -> None:
    error = errors_deg(LostStep(size_deg=1.5, projection=1200))
    np.testing.assert_allclose(error, np.where(np.arange(N) < 1200, 0, -1.5), atol=1e-9)


def test_lost_step_without_a_place_falls_into_the_middle_half() -> None:
    first = [int(np.argmax(errors_deg(LostStep(), seed) < -1)) for seed in range(20)]
    assert min(first) >= N // 4
    assert max(first) < 3 * N // 4
    assert len(set(first)) > 10


def test_eccentric_disc_errs_once_a_turn() -> None:
    error = errors_deg(Eccentric(amplitude_deg=0.3, phase_deg=40.0))
    np.testing.assert_allclose(error, 0.3 * np.sin(NOMINAL + np.deg2rad(40)), atol=1e-9)


@pytest.mark.parametrize("name", ANGLE_ERRORS)
def test_the_same_generator_disturbs_alike_and_leaves_the_nominal_angles(name: str) -> None:
    before = NOMINAL.copy()
    np.testing.assert_array_equal(
        errors_deg(ANGLE_ERRORS[name](), seed=4), errors_deg(ANGLE_ERRORS[name](), seed=4)
    )
    np.testing.assert_array_equal(NOMINAL, before)
