"""Which part of a slice is looked at, and where two slices differ most."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products import Floats, Pixels

Mask = NDArray[np.bool_]

DISC_MARGIN_PX = 1.5
"""Keeps the neighbours that gradients look at inside the field of view."""
ZOOM_SHARE = 0.2
SMALLEST_ZOOM_PX = 8


class Window(NamedTuple):
    """A square part of a slice, px."""

    top: int
    left: int
    side: int

    def cut(self, image: Pixels | Floats) -> Pixels | Floats:
        """Return this part of `image` (z, x)."""
        return image[self.top : self.top + self.side, self.left : self.left + self.side]


def disc(shape: tuple[int, int]) -> Mask:
    """(z, x) True where a slice of `shape` was seen by every projection."""
    return np.asarray(from_middle(shape) <= disc_radius(shape))


def disc_radius(shape: tuple[int, int]) -> float:
    """Radius, px, of the disc that every projection sees."""
    # A slice of any size keeps its middle, so that means over the disc always exist.
    return max((min(shape) - 1) / 2 - DISC_MARGIN_PX, 0.75)


def from_middle(shape: tuple[int, int]) -> Floats:
    """(z, x) distance of each pixel from the middle, px."""
    z, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    return np.asarray(np.hypot(z[:, None], x))


def rms(values: Pixels | Floats) -> float:
    """Root mean square of the finite values, nan if there are none."""
    finite = np.asarray(values[np.isfinite(values)], np.float64)
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")


def most_changed_first(recorded: Pixels, refined: Pixels) -> list[int]:
    """Sort the slices of `recorded` and `refined` (r, z, x) by their rms difference in the disc."""
    inside = disc(recorded.shape[1:])
    changes = [
        rms((after - before)[inside]) for before, after in zip(recorded, refined, strict=True)
    ]
    order = np.argsort(-np.nan_to_num(np.array(changes)), kind="stable")
    return [int(k) for k in order]


def most_changed_material(recorded: Pixels, refined: Pixels, inside: Mask) -> Window:
    """Find the window of slices (z, x) where material changed most."""
    return most_changed_window((refined - recorded) * material(recorded, inside), inside)


def most_changed_window(difference: Pixels | Floats, inside: Mask) -> Window:
    """Find the window with the largest rms of `difference` (z, x) among all that fit.

    The middle of the slice where nothing differs.
    """
    height, width = difference.shape
    side = min(max(round(ZOOM_SHARE * width), SMALLEST_ZOOM_PX), height, width)
    squares = np.where(inside & np.isfinite(difference), difference, 0).astype(np.float64) ** 2
    if not squares.any():
        return Window((height - side) // 2, (width - side) // 2, side)
    sums = np.pad(squares.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    local = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    top, left = np.unravel_index(np.argmax(local), local.shape)
    return Window(int(top), int(left), side)


def material(image: Pixels | Floats, inside: Mask) -> Floats:
    """(z, x) from 0 in air to 1 in what attenuates most: streaks in air interest nobody."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(np.where(inside & (image > 0), image, 0).astype(np.float64), 2)
    full = np.quantile(smooth[inside], 0.99)
    return np.asarray(np.clip(smooth / full, 0, 1) if full > 0 else np.ones_like(smooth))


def grey_limits(images: Pixels | Floats, inside: Mask) -> tuple[float, float]:
    """Range of grey values of all `images` (..., z, x) together, without the few extremes."""
    values = images[..., inside]
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0, 1.0
    low, high = (float(v) for v in np.percentile(values, [0.3, 99.7]))
    if not low < high:
        low, high = float(values.min()), float(values.max())
    return (low, high) if low < high else (low - 0.5, high + 0.5)
