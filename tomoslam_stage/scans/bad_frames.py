"""Frames that no projection can be made of: black, saturated, NaN, or without their beam.

Some rows of every frame are read once. What a frame weighs, the line integrals summed over its
columns, is the same from any direction as long as the object stays in view, and changes slowly
where it does not; a frame that weighs something else than those before and after it has lost, or
gained, light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.images import robust_sigma
from tomoslam_stage.progress import progress
from tomoslam_stage.scans.selection import BLOCK_PIXELS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products import Floats, Integers, Pixels
    from tomoslam_stage.scans.sources import ConvertedSource

BANDS, BAND_ROWS = 8, 8
"""So many bands of so many rows are looked at, spread over the detector."""
NEIGHBOURS = 31
"""Frames, before and after, that a frame is compared with."""
LEAST_CHANGE = 0.25
"""Mean line integral of a band: less light lost or gained does no harm to what is fine."""
SIGMAS = 10.0
"""Standard deviations of the usual change by which a bad frame differs at least."""
BLACK = 0.02
"""Share of the scan's usual light; less of it is none."""
PART = 0.1
"""Share of the pixels that may be NaN, beyond those that mostly are."""
FLAT = 0.5
"""Share of the pixels that hold the largest value there is, where a frame is saturated."""


class Survey(NamedTuple):
    """What every frame is like."""

    weight: Floats
    """(m, b) mean line integral of each band."""
    light: Floats
    """(m, b) share of the beam that comes through to each band."""
    nan: Floats
    """(m,) share of the pixels that are no numbers."""
    top: Floats
    """(m,) largest value, as it is stored."""
    at_top: Floats
    """(m,) share of the pixels that hold just that."""


def survey(frames: ConvertedSource) -> Survey:
    """Look at some rows of all `frames`, in blocks; their source gives what is stored."""
    n, rows, columns = frames.shape
    bands = _bands(rows)
    block = max(1, BLOCK_PIXELS // (bands.size * columns))
    starts = range(0, n, block)
    looks = [
        _look(frames, np.arange(start, min(n, start + block)), bands)
        for start in progress(starts, "looking for bad frames", len(starts))
    ]
    return Survey(*map(np.concatenate, zip(*looks, strict=True)))


def _bands(rows: int) -> Integers:
    """(b, h) rows of each band."""
    height = min(BAND_ROWS, max(1, rows // BANDS))
    count = min(BANDS, rows // height)
    starts = np.linspace(0, rows - height, count).astype(np.intp)
    return starts[:, None] + np.arange(height)


def _look(frames: ConvertedSource, some: Integers, bands: Integers) -> Survey:
    raw = frames.source.read(some, bands.ravel())
    broken = ~np.isfinite(raw)
    top = np.where(broken, -np.inf, raw).max(axis=(1, 2))
    at_top = (raw == top[:, None, None]).mean(axis=(1, 2))
    nan = broken.mean(axis=(1, 2))
    integrals = frames.converted(raw, some, bands.ravel())
    weight = _by_band(integrals, bands)
    light = _by_band(np.exp(-integrals), bands)
    return Survey(weight, light, nan, top.astype(np.float64), at_top)


def _by_band(integrals: Pixels, bands: Integers) -> Floats:
    """(p, b) means of `integrals` (p, r, column) over the rows of each band."""
    whole = integrals.reshape(len(integrals), len(bands), -1)
    return np.asarray(whole.mean(axis=2, dtype=np.float64))


def bad_frames(seen: Survey) -> Mapping[int, str]:
    """Frame -> what is wrong with it, in numbers."""
    change = seen.weight - _around(seen.weight)
    light = seen.light / np.median(seen.light, axis=0)
    spread = np.array([robust_sigma(band) for band in change.T])
    stands_out = np.abs(change) > np.maximum(LEAST_CHANGE, SIGMAS * spread)
    nan = seen.nan > np.median(seen.nan) + PART
    flat = seen.at_top >= np.median(seen.at_top) + FLAT
    saturated = flat & (seen.top >= seen.top.max()) & ~nan
    black = (light.max(axis=1) < BLACK) & ~nan
    lost = stands_out.any(axis=1) & ~(nan | saturated | black)
    found = {int(k): f"{seen.nan[k]:.0%} of it NaN" for k in np.flatnonzero(nan)}
    for k in np.flatnonzero(saturated):
        found[int(k)] = f"saturated: {seen.at_top[k]:.0%} of it holds {seen.top[k]:.6g}"
    for k in np.flatnonzero(black):
        found[int(k)] = f"black: {light[k].mean():.2%} of the usual light"
    for k in np.flatnonzero(lost):
        worst = light[k, np.argmax(np.abs(change[k]))]
        found[int(k)] = f"{light[k].mean():.0%} of the usual light, {worst:.0%} in some rows"
    return dict(sorted(found.items()))


def _around(weight: Floats) -> Floats:
    """(m, b) what the frames around each frame weigh."""
    from scipy.ndimage import median_filter

    window = (min(2 * NEIGHBOURS + 1, len(weight)), 1)
    return np.asarray(median_filter(weight, window, mode="mirror"))
