"""From the angles of the projections used to one for every frame in the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.images import robust_sigma
from tomoslam_stage.products import StageNoise

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers, Scan


class OfFrames(NamedTuple):
    """Angles as they are stored."""

    theta: Floats
    """(m,) radians."""
    sigma: Floats
    """(m,) radians; NaN where nothing was measured on both sides, or nothing recorded."""


def of_all_frames(
    scan: Scan, theta: Floats, sigma: Floats, noise: StageNoise | None = None
) -> OfFrames:
    """Give an angle to frames that were left out, too: their recorded one, corrected as around.

    The correction is interpolated along the scan, as errors of a stage add up along it. Between
    measured frames it is as unsure as a walk that is held at both ends; before the first and after
    the last of them nobody knows.

    Parameters
    ----------
    scan
        Knows which frames its projections are, and what was recorded for the others.
    theta, sigma
        (n,) radians, of its projections.
    noise
        The usual error of the stage; by default all errors of its steps count as a walk.
    """
    if scan.theta_of_frames is None:
        return OfFrames(theta, sigma)
    every, correction = np.arange(len(scan.theta_of_frames)), theta - scan.theta
    known = np.isfinite(scan.theta_of_frames)
    recorded = np.interp(every, every[known], scan.theta_of_frames[known])
    corrected = recorded + np.interp(every, scan.frames, correction)
    spread = _spread(every, scan.frames, sigma, noise or _walk(correction))
    corrected[scan.frames], spread[~known] = theta, np.nan
    return OfFrames(corrected, spread)


def shift_in_file(scan: Scan, shift: Floats) -> Floats:
    """(m,) px of the detector, one for every frame; NaN for those that were left out.

    `shift` (n,) is that of the projections of `scan`, in its px, or its sigma.
    """
    px = scan.binning * shift
    if scan.theta_of_frames is None:
        return px
    every = np.full(len(scan.theta_of_frames), np.nan)
    every[scan.frames] = px
    return every


def _walk(correction: Floats) -> StageNoise:
    return StageNoise(robust_sigma(np.diff(correction)), 0.0)


def _spread(every: Integers, frames: Integers, sigma: Floats, noise: StageNoise) -> Floats:
    """(m,) radians: sigma of the correction, interpolated from that of `frames` (n,)."""
    after = np.searchsorted(frames, every)
    inside = (every >= frames[0]) & (every <= frames[-1])
    after = np.clip(after, 1, len(frames) - 1)
    first, last = frames[after - 1], frames[after]
    way = (every - first) / (last - first)
    measured = (1 - way) * sigma[after - 1] ** 2 + way * sigma[after] ** 2
    walked = noise.walk**2 * way * (last - every) + noise.jitter**2
    spread = np.where(inside, np.sqrt(np.maximum(measured + walked, 0)), np.nan)
    spread[frames] = sigma
    return np.asarray(spread)
