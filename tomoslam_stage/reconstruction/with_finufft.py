"""FBP and SIRT on the embedded projector: nothing else needs to be installed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tomoslam_stage.parallel import BLOCK, in_blocks, parallel
from tomoslam_stage.radon import Radon, continued, object_reach, reach_beyond
from tomoslam_stage.reconstruction.algorithms import Algorithm, Fbp, Gridrec, Iterative, Sirt
from tomoslam_stage.reconstruction.backend import Slices

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels


class Embedded:
    """FBP and SIRT for any angles and any axis, the same for any number of workers.

    Where the object is wider than the detector, either works on the sinograms as `continued`.
    """

    name: ClassVar[str] = "embedded"

    def refusal(self, algorithm: Algorithm) -> str:
        """Why it cannot do just this here; empty where it can."""
        match algorithm:
            case Gridrec():
                return "has no gridrec"
            case Iterative():
                return f"has no {algorithm.name}"
        return ""

    def reconstruct(
        self, algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float
    ) -> Slices:
        """Slices and, of SIRT, the convergence; see `Backend`."""
        match algorithm:
            case Fbp():
                return fbp(algorithm, sinograms, theta, axis)
            case Sirt():
                return sirt(algorithm, sinograms, theta, axis)
        raise ValueError(f"{self.name} {self.refusal(algorithm)}")


def fbp(algorithm: Fbp, sinograms: Pixels, theta: Floats, axis: float) -> Slices:
    """Filter and back-project, `BLOCK` rows at a time."""
    columns = sinograms.shape[-1]
    beyond = reach_beyond(sinograms)
    radon = Radon(theta, axis + beyond, columns + 2 * beyond, columns)

    def of_block(block: Pixels) -> Pixels:
        return radon.fbp(continued(block, beyond), algorithm.window)

    return Slices(in_blocks(of_block, sinograms, "FBP"))


def sirt(algorithm: Sirt, sinograms: Pixels, theta: Floats, axis: float) -> Slices:
    """``x += C A^T R (p - A x)``, `BLOCK` rows at a time.

    R and C are the inverse sums of the rows and columns of A. The slices are solved for as far as
    the object reaches: what lies outside would be piled up at the rim of a smaller disc.
    """
    columns = sinograms.shape[-1]
    beyond = reach_beyond(sinograms)
    margin = max(0, int(np.ceil(object_reach(sinograms, axis, beyond) + 1 - columns / 2)))
    radon = Radon(theta, axis + beyond, columns + 2 * beyond, columns + 2 * margin)
    weights = sirt_weights(radon)
    seen, shown = slice(beyond, beyond + columns), slice(margin, margin + columns)

    def of_block(block: Pixels) -> tuple[Pixels, Floats]:
        wanted = continued(block, beyond)
        slices = np.zeros((len(block), radon.size, radon.size), np.float32)
        squares = np.empty(algorithm.iterations)
        for k in range(algorithm.iterations):
            left = wanted - radon.project(slices)
            squares[k] = np.sum(np.square(left[..., seen], dtype=np.float64))
            slices += weights.pixels * radon.adjoint(weights.rays * left)
            if algorithm.nonnegative:
                np.maximum(slices, 0, out=slices)
        return slices[:, shown, shown], squares

    blocks = np.split(sinograms, range(BLOCK, len(sinograms), BLOCK))
    solved = list(parallel(of_block, blocks, "SIRT"))
    # Summed in the order of the blocks, not in that in which they are done.
    squares = np.sum([squares for _, squares in solved], axis=0)
    slices = np.concatenate([slices for slices, _ in solved])
    return Slices(slices, np.sqrt(squares / sinograms.size))


@dataclass(frozen=True)
class SirtWeights:
    """Inverse sums over rays and over pixels; zero where a ray or a pixel sees nothing."""

    rays: Pixels
    """(n, column) per pixel of path."""
    pixels: Pixels
    """(z, x) per ray; zero outside the disc."""


def sirt_weights(radon: Radon) -> SirtWeights:
    """Project ones in the disc, and back-project ones on the detector."""
    inside = radon.disc().astype(np.float32)
    rays = radon.project(inside[None])[0]
    ones = np.ones((1, *rays.shape), np.float32)
    pixels = radon.adjoint(ones)[0]
    return SirtWeights(
        rays=np.where(rays > 1, 1 / np.maximum(rays, 1), 0),
        pixels=inside / np.maximum(pixels, 1),
    )
