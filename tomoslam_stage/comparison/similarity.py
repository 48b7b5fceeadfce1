"""How near slices are to those made with the true angles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tomoslam_stage.comparison.named import wholes
from tomoslam_stage.comparison.regions import Mask, disc

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels, Reconstructions

Similarity: TypeAlias = Callable[["Pixels", "Pixels", Mask], float]
"""Of one slice (z, x) to the true one, over the pixels where the mask (z, x) holds."""

SSIM_SIGMA, SSIM_REACH = 1.5, 5
"""px: of the Gaussian window, 11 px wide."""
SSIM_K = 0.01, 0.03
"""In units of the true slice's range of grey values."""


def psnr(image: Pixels, true: Pixels, inside: Mask) -> float:
    """Peak signal-to-noise ratio, dB; the peak is the true slice's range of grey values."""
    error = np.sqrt(np.mean(np.square(image - true)[inside], dtype=np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(20 * np.log10(np.ptp(true[inside]) / error))


def ssim(image: Pixels, true: Pixels, inside: Mask) -> float:
    """Mean structural similarity; 1 for the same slice.

    Wang, Bovik, Sheikh and Simoncelli, IEEE Trans. Image Process. 13 (2004) 600, equation 13. The
    window ends where the mask does.
    """
    weight = _blurred(inside.astype(np.float64))

    def local(values: Floats) -> Floats:
        return _blurred(np.where(inside, values, 0))[inside] / weight[inside]

    x, y = image.astype(np.float64), true.astype(np.float64)
    mean_x, mean_y = local(x), local(y)
    spread = local(x * x) - mean_x**2 + local(y * y) - mean_y**2
    common = local(x * y) - mean_x * mean_y
    first, second = (np.square(k * np.ptp(y[inside])) for k in SSIM_K)
    with np.errstate(invalid="ignore"):
        similar = (2 * mean_x * mean_y + first) * (2 * common + second)
        return float(np.mean(similar / ((mean_x**2 + mean_y**2 + first) * (spread + second))))


def _blurred(values: Floats) -> Floats:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, SSIM_SIGMA, radius=SSIM_REACH, mode="constant"))


SIMILARITY: Mapping[str, Similarity] = {"psnr": psnr, "ssim": ssim}
"""All figures of similarity by name; a new one is a function above and a line here."""


def similarity(reconstructions: Reconstructions) -> dict[str, dict[str, float]]:
    """Metric -> name of the reconstruction -> mean over its slices; empty without a true one."""
    made = wholes(reconstructions)
    if "true" not in made or not len(made["true"].slices):
        return {}
    true = made.pop("true").slices
    inside = disc(true.shape[1:])

    def mean(measure: Similarity, slices: Pixels) -> float:
        return float(np.mean([measure(*p, inside) for p in zip(slices, true, strict=True)]))

    return {
        metric: {name: mean(measure, one.slices) for name, one in made.items()}
        for metric, measure in SIMILARITY.items()
    }
