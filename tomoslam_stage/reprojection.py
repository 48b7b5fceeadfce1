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
from tomoslam_stage.parallel import in_blocks
from tomoslam_stage.radon import Radon

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import Floats, Pixels

COARSE_COLUMNS, COARSE_PROJECTIONS = 128, 180
"""The axis is looked for from scratch on so many, or not quite twice as many."""


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
        leave = self._judge(sinograms, theta, axis)

        def of_block(block: Pixels) -> Floats:
            return np.asarray(np.mean(np.square(leave(block), dtype=np.float64), axis=-1))

        return in_blocks(of_block, sinograms)

    def left(self, sinograms: Pixels, theta: Floats, axis: float) -> Pixels:
        """(r, n, column) line integrals: the residual itself; parameters as for `squares`."""
        return in_blocks(self._judge(sinograms, theta, axis), sinograms)

    def _judge(self, sinograms: Pixels, theta: Floats, axis: float) -> Callable[[Pixels], Pixels]:
        """Return what gives the fine part of what is left of some rows."""
        columns = sinograms.shape[-1]
        radon = Radon(theta, axis, columns, columns)
        inside = radon.disc()

        def left(block: Pixels) -> Pixels:
            slices = np.maximum(radon.fbp(block), 0) * inside
            return highpass(block - radon.project(slices), self.cutoff)

        return left

    def find_axis(self, sinograms: Pixels, theta: Floats) -> float:
        """Detector column of the axis that leaves least of `sinograms` (r, n, column), px.

        First on a grid over everything within `axis_reach`, on binned columns and a part of the
        projections, then ever finer on all of them.
        """
        columns = sinograms.shape[-1]
        binning = max(1, columns // COARSE_COLUMNS)
        thinned = slice(None, None, max(1, len(theta) // COARSE_PROJECTIONS))
        small = binned(sinograms[:, thinned], binning)
        middle, reach = (small.shape[-1] - 1) / 2, self.axis_reach * small.shape[-1]
        grid = middle + np.arange(-np.floor(reach), np.floor(reach) + 1)
        left = [self.squares(small, theta[thinned], axis).mean() for axis in grid]
        coarse = (grid[int(np.argmin(left))] + 0.5) * binning - 0.5
        return self.best_axis(sinograms, theta, coarse, binning)

    def best_axis(self, sinograms: Pixels, theta: Floats, start: float, step: float = 1.0) -> float:
        """Detector column near `start` of the axis that leaves least, in steps from `step` px."""
        return lowest(lambda axis: float(self.squares(sinograms, theta, axis).mean()), start, step)


def lowest(function: Callable[[float], float], start: float, step: float) -> float:
    """Where `function` is lowest near `start`, to some hundredths.

    Walk downhill, halve the step where both neighbours are higher, and end with a parabola. On a
    plain it stays where it is.
    """
    known: dict[float, float] = {}

    def at(place: float) -> float:
        if place not in known:
            known[place] = function(place)
        return known[place]

    best = start
    while step > 0.1:
        # The first of equals wins: `best` must come first, or a plain would be walked for ever.
        lower = min((best, best - step, best + step), key=at)
        if lower == best:
            step /= 2
        best = lower
    below, here, above = at(best - 2 * step), at(best), at(best + 2 * step)
    bend = below - 2 * here + above
    return best + step * (below - above) / bend if bend > 0 else best


def binned(sinograms: Pixels, binning: int) -> Pixels:
    """(..., column // binning) means of `binning` columns; what is left over is dropped."""
    columns = sinograms.shape[-1] // binning
    whole = sinograms[..., : columns * binning]
    return np.asarray(whole.reshape(*whole.shape[:-1], columns, binning).mean(axis=-1))
