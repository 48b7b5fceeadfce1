"""Filters on projections and sinograms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels

Window: TypeAlias = Literal["ram-lak", "shepp-logan", "cosine", "hamming", "hann", "parzen"]
"""Apodisations of the ramp filter, from none to the smoothest."""

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


def robust_sigma(values: Pixels | Floats) -> float:
    """Return the standard deviation of `values` that outliers do not move."""
    return robust_scale(values - np.median(values))


def robust_scale(values: Pixels | Floats) -> float:
    """Return the standard deviation of `values` about zero that outliers do not move."""
    return float(ROBUST_SIGMA * np.median(np.abs(values)))


def ramp(length: int, window: Window) -> Floats:
    """(length // 2 + 1,) the discrete ramp of Ram and Lak, times a window.

    Kak and Slaney, Principles of Computerized Tomographic Imaging (1988), equation 3-61.
    """
    from scipy.fft import rfft

    column = np.minimum(np.arange(length), length - np.arange(length))
    kernel = np.zeros(length)
    kernel[0] = 0.25
    odd = column % 2 == 1
    kernel[odd] = -1 / (np.pi * column[odd]) ** 2
    return np.asarray(rfft(kernel).real * WINDOWS[window](np.asarray(2 * np.fft.rfftfreq(length))))


def parzen(x: Floats) -> Floats:
    """Return the window of Parzen (Ann. Math. Statist. 32 (1961) 329) at `x` of its half width."""
    near = 1 - 6 * x**2 * (1 - x)
    return np.where(x < 0.5, near, 2 * (1 - x) ** 3)


WINDOWS: Mapping[Window, Callable[[Floats], Floats]] = {
    "ram-lak": np.ones_like,
    "shepp-logan": lambda x: np.sinc(x / 2),
    "cosine": lambda x: np.cos(np.pi / 2 * x),
    "hamming": lambda x: 0.54 + 0.46 * np.cos(np.pi * x),
    "hann": lambda x: 0.5 + 0.5 * np.cos(np.pi * x),
    "parzen": parzen,
}
"""Name -> weight of a frequency, in units of the highest; from the sharpest to the smoothest."""


def tapered(sinograms: Pixels, before: int, length: int) -> Pixels:
    """Pad the columns to `length`, `before` of them on the left, the end values falling to zero."""
    after = length - before - sinograms.shape[-1]
    padded = np.pad(sinograms, ((0, 0), (0, 0), (before, after)), mode="edge")
    padded[..., :before] *= 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, before, endpoint=False))
    padded[..., length - after :] *= 0.5 + 0.5 * np.cos(np.linspace(0, np.pi, after + 1))[1:]
    return padded


def shifted(sinograms: Pixels, by: Floats) -> Pixels:
    """`sinograms` (r, n, column), each line moved to the right by its own of `by`, px.

    `by` is (r, 1) where all projections move alike, (n,) where all rows do, or (r, n).
    """
    from scipy.fft import irfft, rfft

    if not by.any():
        return sinograms
    columns = sinograms.shape[-1]
    before, length = columns // 2, 2 * columns
    cycles = np.asarray(by)[..., None] * np.fft.rfftfreq(length)
    phase = np.exp(-2j * np.pi * cycles).astype(np.complex64)
    spectrum = rfft(tapered(sinograms, before, length), axis=-1) * phase
    moved = irfft(spectrum, length, axis=-1)[..., before : before + columns]
    return np.asarray(moved, np.float32)


def mirrored(sinograms: Pixels, axis: float) -> Pixels:
    """`sinograms` (r, n, column) seen from behind: mirrored about the column `axis`, px."""
    rows, _, columns = sinograms.shape
    return shifted(sinograms[..., ::-1], np.full((rows, 1), 2 * axis - (columns - 1)))


def still(sinograms: Pixels, shift: Floats | None) -> Pixels:
    """`sinograms` (r, n, column) as if no projection were shifted, by `shift` (n,) px or not."""
    return sinograms if shift is None else shifted(sinograms, -shift)
