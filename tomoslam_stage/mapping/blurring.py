"""What sharp edges hide: line integrals through a blurred edge come out too small.

A detector blurs intensities, not line integrals. Where line integrals change by more than one
within its point spread, it records less than their blurred value. Thick edge-on projections are
full of that, face-on ones are not; no map explains both. So the blur of the intensities is taken
back as far as their noise allows, and put on again after the logarithm.

The exponential edge-gradient effect: Glover and Pelc, Medical Physics 7 (1980) 238; Joseph and
Spital, Physics in Medicine and Biology 26 (1981) 473. Deconvolution by a series of so many terms:
van Cittert, Zeitschrift fuer Physik 69 (1931) 298.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Pixels

TERMS = 6
"""Of the series: by so much it raises noise where the point spread leaves nothing."""
DARKEST = 0.1
"""Of the recorded intensity: left at least, where noise would leave less than nothing."""


def hidden(images: Pixels, blur: float) -> Pixels:
    """(..., row, column) what `images` of line integrals lack, as a point spread hides it.

    `blur` is its standard deviation, px. To first order in small differences, noise for one,
    nothing is hidden.
    """
    from scipy.fft import dctn, idctn

    def waves(values: Pixels) -> Pixels:
        return np.asarray(dctn(values, axes=(-2, -1)))

    kept = passed(images.shape[-2:], blur)
    sharper = (1 - (1 - kept) ** TERMS) / kept
    recorded = np.exp(-images)
    sharp = idctn(waves(recorded) * sharper, axes=(-2, -1), overwrite_x=True)
    integrals = -np.log(np.maximum(sharp, DARKEST * recorded))
    lacking = kept * (waves(integrals) - sharper * waves(images))
    return np.asarray(idctn(lacking, axes=(-2, -1), overwrite_x=True))


def passed(shape: tuple[int, ...], blur: float) -> Pixels:
    """(row, column) share of each cosine that a point spread lets through."""
    by_row, by_column = (np.exp(-((blur * np.pi * np.arange(n) / n) ** 2) / 2) for n in shape)
    return np.asarray(np.outer(by_row, by_column), np.float32)
