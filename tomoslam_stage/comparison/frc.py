"""Fourier ring correlation of two halves of the data: how fine a detail rises above the noise.

Both halves share the wrong angles and may agree on what these make of an edge, so it is shown and
decides nothing. Nor is it for comparing algorithms: what an iterative one does not allow (such as
attenuation below zero) is the same in both halves, and counts as agreement.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.comparison.regions import disc_radius, from_middle

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels

TAPER = 0.25
"""Part of the radius over which the disc fades out: a sharp rim would correlate with itself."""
FINEST_PX = 2.0
"""Period that pixels can just hold."""


class RingCorrelation(NamedTuple):
    """How well two halves agree, by frequency."""

    frequency: Floats
    """(f,) cycles per px, from one over the width of the slices."""
    correlation: Floats
    """(f,) 1 where both halves are the same, around 0 where there is but noise."""
    threshold: Floats
    """(f,) the half-bit curve: below it there is too little to be told from noise."""

    @property
    def resolution_px(self) -> float:
        """Period, px, at which the correlation first falls below the threshold.

        Two pixels where it never does, nan where it is below from the start.
        """
        above = self.correlation - self.threshold
        below = np.flatnonzero(~(above >= 0))
        if not len(below):
            return FINEST_PX
        k = int(below[0])
        if k == 0:
            return float("nan")
        share = above[k - 1] / (above[k - 1] - above[k])
        return float(1 / (self.frequency[k - 1] + share * np.diff(self.frequency)[k - 1]))


def ring_correlation(even: Pixels, odd: Pixels) -> RingCorrelation:
    """Correlate `even` with `odd`, both (r, z, x), on rings of all their spectra together.

    Saxton and Baumeister, J. Microsc. 127 (1982) 127, with the half-bit threshold of van Heel and
    Schatz, J. Struct. Biol. 151 (2005) 250, as is usual for slices of X-ray tomography. (The fixed
    1/7 of Nieuwenhuizen et al., Nat. Methods 10 (2013) 557, is its limit of 0.17 for large rings,
    nearly.)
    """
    from scipy.fft import fftfreq, rfft2, rfftfreq

    height, width = even.shape[1:]
    window = tapered_disc((height, width))
    first, second = (rfft2(_centred(half, window) * window) for half in (even, odd))
    radius = np.hypot(fftfreq(height)[:, None], rfftfreq(width))
    n = min(height, width)
    ring = np.rint(radius * n).astype(np.intp).ravel()
    # Half of the plane stands for both, but for the columns that are their own mirror image.
    mirrored = np.where(np.isin(rfftfreq(width), (0.0, 0.5)), 1.0, 2.0)

    def on_rings(values: Floats) -> Floats:
        sums = np.bincount(ring, (values * mirrored).ravel())
        return np.asarray(sums[1 : n // 2 + 1], np.float64)

    common = on_rings(np.sum((first * second.conj()).real, axis=0, dtype=np.float64))
    powers = [on_rings(np.sum(np.abs(s) ** 2, axis=0, dtype=np.float64)) for s in (first, second)]
    counts = on_rings(np.full(radius.shape, float(len(even))))
    with np.errstate(invalid="ignore"):
        correlation = common / np.sqrt(powers[0] * powers[1])
    return RingCorrelation(np.arange(1, n // 2 + 1) / n, correlation, half_bit(counts))


def half_bit(counts: Floats) -> Floats:
    """Threshold for rings of so many pixels: half a bit of information in each of all the data.

    Van Heel and Schatz, equation 17: a signal-to-noise ratio of 0.2071 in either half.
    """
    ratio, scatter = np.sqrt(2) / 2 - 0.5, 1 / np.sqrt(counts)
    shared = ratio + 2 * np.sqrt(ratio) * scatter
    return np.asarray((shared + scatter) / (shared + 1))


def tapered_disc(shape: tuple[int, int]) -> Floats:
    """(z, x) 1 inside the field of view, falling to 0 at its rim as a cosine does."""
    radius = disc_radius(shape)
    depth = np.clip((radius - from_middle(shape)) / (TAPER * radius), 0, 1)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * depth))


def _centred(slices: Pixels, window: Floats) -> Floats:
    """(r, z, x) `slices` without their mean, which would correlate for whatever they show."""
    total = max(float(window.sum()), np.finfo(float).tiny)
    mean = np.einsum("rzx,zx->r", slices, window) / total
    return np.asarray(slices - mean[:, None, None])
