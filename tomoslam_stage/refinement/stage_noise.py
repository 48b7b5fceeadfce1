"""What the refined angles tell about the rotation stage: its usual error, and its lapses."""

from __future__ import annotations

import numpy as np

from tomoslam_stage.geometry import mean_near, number_near
from tomoslam_stage.images import robust_sigma
from tomoslam_stage.products import Event, Floats, StageNoise

LEAST_DEG = 0.002
"""No stage is taken for better than this, degrees a step: the encoder would outvote everything."""
MOST_DEG = 5.0
"""No stage is taken for worse than this, degrees."""
LAPSE = 6.0
"""Standard deviations from which on an error of a step is an event."""
LEAST_LAPSE_DEG = 0.1
"""Smallest event, degrees."""
CORRELATED = 1.5
"""By how much neighbouring steps, which share an angle, add to the scatter of a mean of squares."""
SUREST = 1e-4
"""Of the usual variance of measured steps: none is surer than this."""
SAME_STEP = 0.15
"""Part of the usual step by which a lapse may differ from it and still be a matter of frames."""


def stage_noise(
    recorded: Floats, correction: Floats, halves: Floats, stage_steps: Floats | float = 1.0
) -> StageNoise:
    """Size and kind of the errors of the recorded angles, by maximum likelihood.

    Errors of steps (a walk) are independent and add up; an error of a single angle (jitter) makes
    one step too long and the next too short. So the covariance of the steps has two diagonals, as
    has that of their measurement, which is taken from halves of the data, where the angles are
    seen: formal sigmas allow for errors that neighbours share, and would explain any jitter. Lapses
    count no more than three usual errors.

    Parameters
    ----------
    recorded
        (n,) radians.
    correction
        (n,) radians, refined minus recorded, from everything but the encoder.
    halves
        (s, n) radians: for each source, how halves of its data would move the angles.
    stage_steps
        (n - 1,) that the stage made each time, or one number.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded
    from scipy.optimize import minimize

    steps = usual_steps(correction, stage_steps)
    measured, shared = measured_steps(recorded, halves)

    def unlikely(logarithms: Floats) -> float:
        walk, jitter = np.exp(2 * logarithms)
        band = np.zeros((2, len(steps)))
        band[0, 1:], band[1] = shared - jitter, measured + stage_steps * walk + 2 * jitter
        root = cholesky_banded(band)
        return float(2 * np.log(root[1]).sum() + steps @ cho_solve_banded((root, False), steps))

    size = np.log(max(float(np.std(steps)), np.deg2rad(LEAST_DEG)))
    least, most = np.log(np.deg2rad(LEAST_DEG)), np.log(np.deg2rad(MOST_DEG))
    starts = [(size, least), (least, size - 0.35), (size - 0.35, size - 0.7)]
    fits = [minimize(unlikely, np.clip(s, least, most), bounds=[(least, most)] * 2) for s in starts]
    walk, jitter = np.exp(min(fits, key=lambda fit: float(fit.fun)).x)
    return StageNoise(float(walk), float(jitter) if jitter > 1.01 * np.exp(least) else 0.0)


def measured_steps(recorded: Floats, halves: Floats) -> tuple[Floats, Floats]:
    """(n - 1,) variances of measured steps, and (n - 2,) covariances of each with the next.

    Radians squared, from the `halves` (s, n) near each of the `recorded` (n,) angles, on either
    side. A few dozen squares scatter: places differ by the power of what was found for them that
    chance does not explain. Neighbours err independently or against each other, everywhere alike:
    what they share makes no step.
    """
    apart, side = np.diff(halves, axis=1), np.mod(recorded[:-1], np.pi)
    squares, products = (apart**2).sum(axis=0), (apart[:, 1:] * apart[:, :-1]).sum(axis=0)
    usual = squares.mean()
    if usual == 0:
        return squares, products
    near = np.maximum(mean_near(squares, side) / usual, SUREST)
    by_chance = CORRELATED * np.var(squares / usual / near) / number_near(side)
    scatter = np.var(np.log(near))
    places = near ** (1 - by_chance / scatter if scatter > by_chance else 0)
    variances = usual * places / places.mean()
    both = np.sqrt(variances[1:] * variances[:-1])
    return variances, np.clip(np.mean(products / both), -0.5, 0) * both


def usual_steps(correction: Floats, stage_steps: Floats | float) -> Floats:
    """(n - 1,) errors of the steps, none of them beyond three times the usual.

    Errors of `stage_steps` (n - 1,) add up.
    """
    steps, more = np.diff(correction), np.sqrt(stage_steps)
    middle = np.median(steps)
    reach = more * max(3 * robust_sigma(steps / more), np.deg2rad(LEAST_DEG))
    return np.asarray(np.clip(steps, middle - reach, middle + reach))


def lapses(
    recorded: Floats, correction: Floats, variances: Floats, stage_steps: Floats | float = 1.0
) -> tuple[Event, ...]:
    """Name the steps whose error is far outside the noise of the stage and of its measurement.

    Parameters
    ----------
    recorded
        (n,) radians.
    correction
        (n,) radians, refined minus recorded.
    variances
        (n - 1,) of the refined steps, radians squared.
    stage_steps
        (n - 1,) that the stage made each time: errors of several add up.
    """
    errors = np.diff(correction)
    unknown = stage_steps * robust_sigma(errors) ** 2 + np.maximum(variances, 0)
    spread = np.maximum(np.sqrt(unknown), np.deg2rad(LEAST_DEG))
    significance = np.abs(errors - np.median(errors)) / spread
    large = np.abs(np.degrees(errors)) >= LEAST_LAPSE_DEG
    steps = np.diff(recorded)
    return tuple(
        Event(
            int(k) + 1, float(np.degrees(errors[k])), float(significance[k]), kind(errors, steps, k)
        )
        for k in np.flatnonzero(large & (significance >= LAPSE))
    )


def kind(errors: Floats, steps: Floats, k: np.intp) -> str:
    """Say what the error of step `k` looks like, among the recorded `steps` (n - 1,)."""
    if 0 < k < len(steps) and steps[k] * steps[k - 1] < 0:
        return "backlash"
    usual = np.median(np.abs(steps))
    if abs(abs(errors[k]) - usual) <= SAME_STEP * usual:
        return "dropped frame" if errors[k] * steps[k] > 0 else "duplicated frame"
    return "lost step"
