"""FBP and SIRT on the embedded projector: nothing else needs to be installed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.parallel import in_blocks
from tomoslam_stage.products import Floats, Pixels
from tomoslam_stage.radon import Radon, Window


@method
class Fbp:
    """Filtered back-projection; each projection weighs as much as the angle it stands for."""

    window: Window = "shepp-logan"
    """Apodisation of the ramp: ``ram-lak`` (none), ``shepp-logan`` or ``hann`` (smoothest)."""

    def slices(self, sinograms: Pixels, theta: Floats, axis: float) -> Pixels:
        """Slices (r, z, x), see `Algorithm`."""
        radon = Radon(theta, axis, sinograms.shape[-1], sinograms.shape[-1])
        return in_blocks(lambda block: radon.fbp(block, self.window), sinograms, "FBP")


@method
class Sirt:
    """Simultaneous iterative reconstruction (Gilbert, J. Theor. Biol. 36 (1972) 105).

    ``x += C A^T R (p - A x)`` where R and C are the inverse sums of the rows and columns of A.
    """

    iterations: Annotated[int, Field(ge=1)] = 100
    """Times that all projections are used."""
    nonnegative: bool = True
    """Attenuation below zero is set to zero in every iteration."""

    def slices(self, sinograms: Pixels, theta: Floats, axis: float) -> Pixels:
        """Slices (r, z, x), see `Algorithm`."""
        radon = Radon(theta, axis, sinograms.shape[-1], sinograms.shape[-1])
        weights = sirt_weights(radon)

        def solve(block: Pixels) -> Pixels:
            slices = np.zeros((len(block), radon.size, radon.size), np.float32)
            for _ in range(self.iterations):
                left = weights.rays * (block - radon.project(slices))
                slices += weights.pixels * radon.adjoint(left)
                if self.nonnegative:
                    np.maximum(slices, 0, out=slices)
            return slices

        return in_blocks(solve, sinograms, "SIRT")


@dataclass(frozen=True)
class SirtWeights:
    """Inverse sums over rays and over pixels; zero where a ray or a pixel sees nothing."""

    rays: Pixels
    """(n, column) per pixel of path."""
    pixels: Pixels
    """(z, x) per ray; zero outside the disc that all projections see."""


def sirt_weights(radon: Radon) -> SirtWeights:
    """Project ones in the field of view, and back-project ones on the detector."""
    inside = radon.disc().astype(np.float32)
    rays = radon.project(inside[None])[0]
    ones = np.ones((1, *rays.shape), np.float32)
    pixels = radon.adjoint(ones)[0]
    return SirtWeights(
        rays=np.where(rays > 1, 1 / np.maximum(rays, 1), 0),
        pixels=inside / np.maximum(pixels, 1),
    )
