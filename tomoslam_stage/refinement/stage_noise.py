"""What the refined angles tell about the rotation stage: its usual error, and its lapses."""

from __future__ import annotations

import numpy as np

from tomoslam_stage.images import robust_sigma
from tomoslam_stage.products import Event, Floats, StageNoise

LEAST_DEG = 0.002
"""No stage is taken for better than this, degrees a step: the encoder would outvote everything."""
MOST_DEG = 5.0
"""No stage is taken for worse than this, degrees."""
SMOOTHING = 21
"""Frequencies over which the power of the difference of halves is averaged."""
LAPSE = 6.0
"""Standard deviations from which on an error of a step is an event."""
LEAST_LAPSE_DEG = 0.1
"""Smallest event, degrees."""
SAME_STEP = 0.15
"""Part of the usual step by which a lapse may differ from it and still be a matter of frames."""


def stage_noise(
    correction: Floats, halves: Floats, stage_steps: Floats | float = 1.0
) -> StageNoise:
    """Size and kind of the errors of the recorded angles, by maximum likelihood.

    Errors of steps (a walk) are independent and add up; an error of a single angle makes one step
    too long and the next too short. The sine transform makes the steps of both kinds independent,
    with variances ``walk^2 + 4 jitter^2 sin^2(pi k / 2 n)``, beside that of their measurement
    (Whittle, Ark. Mat. 2 (1953) 423). That is taken from halves of the data: formal sigmas allow
    for errors that neighbours share, and would explain any jitter. Lapses count no more than three
    usual errors.

    Parameters
    ----------
    correction
        (n,) radians, refined minus recorded, from everything but the encoder.
    halves
        (s, n) radians: for each source, how halves of its data would move the angles.
    stage_steps
        (n - 1,) that the stage made each time, of which the usual number counts.
    """
    from scipy.fft import dst
    from scipy.ndimage import uniform_filter1d
    from scipy.optimize import minimize

    steps = usual_steps(correction)
    power = dst(steps, type=1, norm="ortho") ** 2
    apart = dst(np.diff(halves, axis=1), type=1, axis=1, norm="ortho") ** 2
    measured = uniform_filter1d(apart.sum(axis=0), SMOOTHING, mode="nearest")
    wave = np.pi * np.arange(1, len(steps) + 1) / (2 * (len(steps) + 1))
    made = float(np.median(stage_steps))

    def unlikely(logarithms: Floats) -> float:
        walk, jitter = np.exp(2 * logarithms)
        variance = made * walk + 4 * jitter * np.sin(wave) ** 2 + measured
        return float(np.sum(np.log(variance) + power / variance))

    size = np.log(max(float(np.std(steps)), np.deg2rad(LEAST_DEG)))
    least, most = np.log(np.deg2rad(LEAST_DEG)), np.log(np.deg2rad(MOST_DEG))
    starts = [(size, least), (least, size - 0.35), (size - 0.35, size - 0.7)]
    fits = [minimize(unlikely, np.clip(s, least, most), bounds=[(least, most)] * 2) for s in starts]
    walk, jitter = np.exp(min(fits, key=lambda fit: float(fit.fun)).x)
    return StageNoise(float(walk), float(jitter) if jitter > 1.01 * np.exp(least) else 0.0)


def usual_steps(correction: Floats) -> Floats:
    """(n - 1,) errors of the steps, none of them beyond three times the usual."""
    steps = np.diff(correction)
    middle = np.median(steps)
    reach = max(3 * robust_sigma(steps), np.deg2rad(LEAST_DEG))
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
