"""Loop closures: half a turn on, a projection is its own mirror image; a full turn on, itself.

Where a projection fits among those of half a turn before says where it lies between them. That
needs no features, no map and no model of the object: opposite rays are the same rays, however thick
the object is and wherever it ends. What it cannot see are errors that repeat every half turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from pydantic import Field

from tomoslam_stage.images import mirrored
from tomoslam_stage.methods import method
from tomoslam_stage.products import Closures
from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers, Pixels

TURNS = (1, 2)
"""Half turns after which the loop closes."""
WIDER = 4.0
"""What is smoother than this many times `fine` does not count."""


class Place(NamedTuple):
    """Where one projection fits among three others."""

    nearest: int
    """The most similar one."""
    beside: int
    """Its neighbour on the side where the projection lies."""
    share: float
    """Of the way from the one to the other."""
    sigma: float
    """Radians, as groups of rows scatter."""


@method
class LoopClosure:
    """Compares each projection with those of half a turn and of a full turn before.

    Squared differences to three neighbours lie on a parabola; its lowest point is the place. White
    noise lifts all three alike and moves nothing.
    """

    fine: Annotated[float, Field(gt=0)] = 1.5
    """px: Gaussian that the projections are smoothed with along the columns."""
    rows: Annotated[int, Field(ge=8)] = 64
    """At most so many rows are compared."""
    groups: Annotated[int, Field(ge=2)] = 8
    """Groups of rows that show by their scatter how sure a closure is."""
    reach_deg: Annotated[float, Field(gt=0)] = 3.0
    """How far from where it was recorded a projection may lie, degrees."""
    widest_deg: Annotated[float, Field(gt=0)] = 3.0
    """Neighbours further apart, degrees, are not interpolated between."""
    floor_deg: Annotated[float, Field(ge=0)] = 0.03
    """Standard deviation of each closure that rows do not show, degrees: neighbours err, too."""

    def measure(self, sinograms: Pixels, theta: Floats, axis: float) -> Closures:
        """Find closures.

        Parameters
        ----------
        sinograms
            (r, n, column) line integrals.
        theta
            (n,) radians, unwrapped: the recorded angles.
        axis
            Detector column of the rotation axis, px.
        """
        order = np.argsort(theta, kind="stable")
        plain = self._grouped(sinograms[:, order])
        pictures = {0: plain, 1: self._grouped(mirrored(sinograms[:, order], axis))}
        found = [
            (turn, j, place)
            for turn in TURNS
            for j in progress(range(len(theta)), "closing loops", len(theta))
            if (place := self._place(pictures[turn % 2][j], plain, theta[order], (turn, j)))
        ]
        if not found:
            return Closures.none()
        turns, last, places = zip(*found, strict=True)
        near, beside, share, sigma = (np.array(part) for part in zip(*places, strict=True))
        return Closures(
            projections=order[np.stack([np.array(last), near, beside], axis=1)],
            share=share,
            turn=np.pi * np.array(turns),
            sigma=np.hypot(sigma, np.deg2rad(self.floor_deg)),
        )

    def _grouped(self, sinograms: Pixels) -> Pixels:
        """(n, group, pixel) the fine part of `sinograms` (r, n, column), rows in groups."""
        from scipy.ndimage import gaussian_filter1d

        smooth, smoother = (
            gaussian_filter1d(sinograms, width, axis=-1) for width in (self.fine, WIDER * self.fine)
        )
        rows, n, columns = sinograms.shape
        each = rows // self.groups
        cut = (smooth - smoother)[: each * self.groups].reshape(self.groups, each, n, columns)
        return np.ascontiguousarray(cut.transpose(2, 0, 1, 3).reshape(n, self.groups, -1))

    def _place(
        self, picture: Pixels, others: Pixels, theta: Floats, which: tuple[int, int]
    ) -> Place | None:
        """Find where `picture` (group, pixel) fits among `others` (n, group, pixel), by angle."""
        turn, j = which
        expected = theta[j] - turn * np.pi
        reach = np.deg2rad(self.reach_deg)
        first, last = np.searchsorted(theta, [expected - reach, expected + reach])
        if last - first < 3:
            return None
        apart = np.square(others[first:last] - picture).sum(axis=-1, dtype=np.float64)
        lowest = int(np.argmin(apart.sum(axis=-1)))
        if not 0 < lowest < last - first - 1:
            return None
        three = np.arange(lowest - 1, lowest + 2)
        angles = theta[first + three]
        if np.ptp(angles) > np.deg2rad(self.widest_deg) or np.diff(angles).min() <= 0:
            return None
        return fitted(apart[three], angles, first + three)


def fitted(apart: Floats, angles: Floats, which: Integers) -> Place | None:
    """Put parabolas through the differences `apart` (3, group) at `angles` (3,), radians."""
    x = angles - angles[1]
    slopes = (apart[[0, 2]] - apart[1]) / x[[0, 2], None]
    bend = (slopes[1] - slopes[0]) / (x[2] - x[0])
    tilt = slopes[0] - bend * x[0]
    if bend.sum() <= 0:
        return None
    place = -tilt.sum() / (2 * bend.sum())
    # Each group's own place differs from that of all by its share of the slope there.
    scatter = np.square(tilt + 2 * bend * place).sum() * len(bend) / (len(bend) - 1)
    sigma = float(np.sqrt(scatter) / (2 * bend.sum()))
    side = 2 if place > 0 else 0
    share = float(place / x[side])
    if share > 1:
        return None
    return Place(int(which[1]), int(which[side]), share, sigma)
