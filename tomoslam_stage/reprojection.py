"""How well a reconstruction explains the projections it was made from, and with which axis.

Reconstruct with some angles and some axis, project the result, and look at what is left: wrong
angles blur the slices and leave more. Only the fine part is looked at. The smooth part carries the
errors of the flat field, of beam hardening and of truncation, not the angle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.images import highpass
from tomoslam_stage.methods import method
from tomoslam_stage.parallel import parallel
from tomoslam_stage.radon import Radon

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import Floats, Pixels

BLOCK = 4
"""Rows reconstructed together: bounds the memory, and is the same for any number of cores."""
COARSE = 128
"""Columns of the sinograms on which the axis is looked for from scratch."""


@method
class Reprojection:
    """Looks at what is left of the projections after reconstruction and reprojection."""

    cutoff: Annotated[float, Field(gt=0)] = 8.0
    """What is smoother along the columns than a Gaussian of this width, px, does not count."""
    axis_reach: Annotated[float, Field(gt=0, lt=0.5)] = 0.2
    """How far from the middle of the detector the axis may lie, in widths of it."""

    def squares(self, sinograms: Pixels, theta: Floats, axis: float) -> Floats:
        """(r, n) mean square of the residual of each row and projection.

        Parameters
        ----------
        sinograms
            (r, n, column) line integrals.
        theta
            (n,) radians.
        axis
            Detector column of the rotation axis, px.
        """
        columns = sinograms.shape[-1]
        radon = Radon(theta, axis, columns, columns)
        inside = radon.disc()

        def of_block(block: Pixels) -> Floats:
            slices = np.maximum(radon.fbp(block), 0) * inside
            left = highpass(block - radon.project(slices), self.cutoff)
            return np.mean(np.square(left, dtype=np.float64), axis=-1)

        blocks = np.split(sinograms, range(BLOCK, len(sinograms), BLOCK))
        return np.concatenate(list(parallel(of_block, blocks)))

    def find_axis(self, sinograms: Pixels, theta: Floats) -> float:
        """Detector column of the axis that leaves least of `sinograms` (r, n, column), px.

        First on a grid over everything within `axis_reach`, on binned columns and at most 180
        projections, then ever finer on all of them.
        """
        columns = sinograms.shape[-1]
        binning = max(1, columns // COARSE)
        thinned = slice(None, None, max(1, len(theta) // 180))
        small = binned(sinograms[:, thinned], binning)
        middle, reach = (small.shape[-1] - 1) / 2, self.axis_reach * small.shape[-1]
        grid = middle + np.arange(-np.floor(reach), np.floor(reach) + 1)
        left = [self.squares(small, theta[thinned], axis).mean() for axis in grid]
        coarse = (grid[int(np.argmin(left))] + 0.5) * binning - 0.5
        return self.best_axis(sinograms, theta, coarse, binning)

    def best_axis(
        self, sinograms: Pixels, theta: Floats, start: float, step: float = 1.0
    ) -> float:
        """Detector column near `start` of the axis that leaves least, in steps from `step` px."""
        return lowest(
            lambda axis: float(self.squares(sinograms, theta, axis).mean()), start, step
        )


def lowest(function: Callable[[float], float], start: float, step: float) -> float:
    """Where `function` is lowest, to some hundredths: walk downhill, then halve the step."""
    known: dict[float, float] = {}

    def at(place: float) -> float:
        if place not in known:
            known[place] = function(place)
        return known[place]

    best = start
    while step > 0.1:
        nearest = min((best - step, best, best + step), key=at)
        if nearest == best:
            step /= 2
        best = nearest
    below, here, above = at(best - 2 * step), at(best), at(best + 2 * step)
    bend = below - 2 * here + above
    return best + step * (below - above) / bend if bend > 0 else best


def binned(sinograms: Pixels, binning: int) -> Pixels:
    """Average `binning` columns at a time; what is left over on the right is dropped."""
    columns = sinograms.shape[-1] // binning
    whole = sinograms[..., : columns * binning]
    return whole.reshape(*sinograms.shape[:-1], columns, binning).mean(axis=-1)
