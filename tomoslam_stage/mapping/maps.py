"""The map: slices that explain the sinograms, with as little detail of their own as can be.

Filtered back-projection, nothing negative, total variation, and one proximal step on what is left.
The projections are compared with what a map with the window of Hann can show at best: with the
projections seen through that window. Whatever else they hold would push the angles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Pixels
    from tomoslam_stage.radon import Radon

DUAL_STEPS = 15
"""Steps of the total variation's dual."""


def mapped(sinograms: Pixels, radon: Radon, strength: float) -> Pixels:
    """(r, z, x) the map of `sinograms` (r, n, column), per px of theirs.

    `strength` is that of the total variation, in standard deviations of each slice.
    """
    inside = radon.disc()
    slices = np.maximum(radon.fbp(sinograms), 0) * inside
    weights = strength * contrast(slices)
    slices = denoised(slices, weights)
    missing = radon.fbp(seen(sinograms) - radon.project(slices))
    return np.asarray(np.maximum(denoised(slices + missing, weights), 0) * inside)


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
