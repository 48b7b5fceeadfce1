"""Filters on projections and sinograms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Pixels

ROBUST_SIGMA = 1.4826
"""Standard deviation of normal noise, in units of its median absolute deviation."""


def highpass(sinograms: Pixels, sigma: float) -> Pixels:
    """Take off what is smoother along the columns than a Gaussian of `sigma` px."""
    from scipy.ndimage import gaussian_filter1d

    return sinograms - gaussian_filter1d(sinograms, sigma, axis=-1, mode="nearest")


def bandpass(projection: Pixels, fine: float, coarse: float) -> Pixels:
    """Keep of a projection (row, column) what lies between two Gaussians of `fine`, `coarse` px."""
    from scipy.ndimage import gaussian_filter

    kept = gaussian_filter(projection, fine, mode="nearest") if fine > 0 else projection
    return kept - gaussian_filter(projection, coarse, mode="nearest")


def noise_sigma(image: Pixels) -> float:
    """Return the standard deviation of the white noise in `image` (row, column).

    The median of its second differences along both directions, which edges hardly move.

    After Immerkaer, Computer Vision and Image Understanding 64 (1996) 300, who takes the mean.
    An image of less than three rows or columns has no second differences: 0.
    """
    if min(image.shape) < 3:
        return 0.0
    twice = image[:-2] - 2 * image[1:-1] + image[2:]
    both = twice[:, :-2] - 2 * twice[:, 1:-1] + twice[:, 2:]
    return float(ROBUST_SIGMA * np.median(np.abs(both)) / 6)


def robust_sigma(values: Pixels) -> float:
    """Return the standard deviation of `values` that outliers do not move."""
    return float(ROBUST_SIGMA * np.median(np.abs(values - np.median(values))))
