"""The map: slices that explain the sinograms, with as little detail of their own as can be.

Filtered back-projection, nothing negative, total variation, and one proximal step on what is left.
Beside thin layers that is not good enough: noise and streaks in the air, cut at zero, leave a rim
that makes a plate look thicker, edge on, and turns the angles to either side towards it. There the
air is found and made empty instead, and what is left may have either sign.
The projections are compared with what a map with the window of Hann can show at best: with the
projections seen through that window. Whatever else they hold would push the angles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Pixels
    from tomoslam_stage.radon import Radon

CORRECTIONS = 4
"""Steps by what is left, where no other prior holds the map back: what a map does not show that it
could show pulls the angles."""
DUAL_STEPS = 15
"""Steps of the total variation's dual."""
SMOOTHING = 1.5
"""Px over which a slice is smoothed to see where there is air."""
RIM = 3
"""Px around what is no air where there may be something, too."""


def mapped(sinograms: Pixels, radon: Radon, strength: float, *, faintest: float = 0.0) -> Pixels:
    """(r, z, x) the map of `sinograms` (r, n, column), per px of theirs.

    Parameters
    ----------
    sinograms
        (r, n, column) line integrals.
    radon
        Where they look from.
    strength
        Of the total variation, in standard deviations of each slice.
    faintest
        Share of the densest place below which there is air, which is made empty; with 0 what is
        negative is, instead.
    """
    slices, inside = radon.fbp(sinograms), radon.disc()
    somewhere = around_objects(slices, inside, faintest) if faintest else inside

    def possible(values: Pixels) -> Pixels:
        return np.asarray((values if faintest else np.maximum(values, 0)) * somewhere)

    slices, wanted = possible(slices), seen(sinograms)
    weights = strength * contrast(slices)
    slices = denoised(slices, weights)
    for _ in range(CORRECTIONS if faintest else 1):
        missing = wanted - radon.project(slices)
        missing -= standing(missing)
        slices = possible(denoised(slices + radon.fbp(missing), weights))
    return slices


def around_objects(slices: Pixels, inside: NDArray[np.bool_], faintest: float) -> NDArray[np.bool_]:
    """(r, z, x) where `slices` (r, z, x) show something, or nearly, `inside` (z, x)."""
    from scipy.ndimage import binary_dilation, gaussian_filter, generate_binary_structure

    smooth = gaussian_filter(slices, (0, SMOOTHING, SMOOTHING)) * inside
    found = smooth > faintest * smooth.max(axis=(1, 2), keepdims=True)
    beside = generate_binary_structure(2, 1)[None]
    return np.asarray(binary_dilation(found, beside, iterations=RIM) & inside)


def standing(residuals: Pixels) -> Pixels:
    """(r, 1, column) what all projections have at the same place, of `residuals` (r, n, column).

    It is the detector's: noise of the flats, dust that moved. It makes rings, and pulls angles that
    are neighbours alike.
    """
    return np.asarray(residuals.mean(axis=1, keepdims=True))


def contrast(slices: Pixels) -> Pixels:
    """(r,) standard deviation of what is there in each of `slices` (r, z, x)."""
    there = [one[one > 0] for one in slices]
    return np.array([some.std() if len(some) else 0 for some in there], np.float32)


def seen(sinograms: Pixels) -> Pixels:
    """`sinograms` (r, n, column) through the window of Hann, whose kernel has three columns."""
    wide = np.pad(sinograms, ((0, 0), (0, 0), (1, 1)), mode="edge")
    return np.asarray(sinograms / 2 + (wide[..., :-2] + wide[..., 2:]) / 4, np.float32)


def denoised(slices: Pixels, weights: Pixels) -> Pixels:
    """`slices` (r, z, x) with less total variation, each as its own of `weights` (r,) says.

    Minimises ``|u - slice|^2 / 2 + weight TV(u)`` through the dual (Beck and Teboulle, IEEE
    Trans. Image Process. 18 (2009) 2419).
    """
    if not weights.any():
        return slices
    return np.stack(
        [
            _denoised(one, weight) if weight else one
            for one, weight in zip(slices, weights, strict=True)
        ]
    )


def _denoised(image: Pixels, weight: np.float32) -> Pixels:
    """`image` (z, x) with less total variation."""
    step = np.float32(1 / (8 * weight))
    flow = np.zeros((2, *image.shape), np.float32)
    ahead, momentum = flow, 1.0
    for _ in range(DUAL_STEPS):
        new = ahead + step * _gradient(image + weight * _divergence(ahead))
        new /= np.maximum(1, np.sqrt(new[0] * new[0] + new[1] * new[1]))
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + np.float32((momentum - 1) / following) * (new - flow)
        flow, momentum = new, following
    return image + weight * _divergence(flow)


def _gradient(image: Pixels) -> Pixels:
    """(2, z, x) differences of `image` (z, x) to the next pixel along z and x."""
    differences = np.zeros((2, *image.shape), np.float32)
    np.subtract(image[1:], image[:-1], out=differences[0, :-1])
    np.subtract(image[:, 1:], image[:, :-1], out=differences[1, :, :-1])
    return differences


def _divergence(flow: Pixels) -> Pixels:
    """(z, x) what flows in: the negative adjoint of `_gradient`."""
    inflow: Pixels = flow[0] + flow[1]
    inflow[-1] -= flow[0, -1]
    inflow[:, -1] -= flow[1, :, -1]
    inflow[1:] -= flow[0, :-1]
    inflow[:, 1:] -= flow[1, :, :-1]
    return inflow
