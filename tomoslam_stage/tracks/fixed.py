"""Keypoints fixed to the detector: dust, hot pixels, rings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats
    from tomoslam_stage.tracks.detectors import Keypoints


@method
class FixedToDetector:
    """Recognises places where a keypoint shows up again and again while the object turns.

    A feature of the object crosses a pixel within a few projections; a speck of dust sits there in
    all of them. What lies on the axis itself stands still as well: it says nothing about angles.
    """

    radius: Annotated[int, Field(ge=1)] = 1
    """How far keypoints of one place lie from its middle, px along rows and along columns."""
    share: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Share of the projections, spread over the whole turn, that makes a place suspect."""
    excess: Annotated[float, Field(ge=1)] = 4.0
    """How many times more often than its surroundings a suspect place must be hit."""

    def find(self, keypoints: Sequence[Keypoints], theta: Floats) -> list[NDArray[np.bool_]]:
        """For each projection (k,) whether a keypoint is fixed to the detector."""
        row = np.concatenate([k.row for k in keypoints])
        column = np.concatenate([k.column for k in keypoints])
        owner = np.repeat(np.arange(len(keypoints)), [len(k) for k in keypoints])
        fixed = np.zeros(len(row), bool)
        if len(row):
            fixed = self._crowded(row, column, owner, sectors(theta))
        return np.split(fixed, np.cumsum([len(k) for k in keypoints])[:-1])

    def _crowded(
        self, row: Floats, column: Floats, owner: NDArray[np.intp], sector: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """(k,) whether the place of a keypoint is hit too often, and from most sectors.

        Parameters
        ----------
        row, column
            (k,) px, of the keypoints of all projections.
        owner
            (k,) projection of each.
        sector
            (n,) see `sectors`.
        """
        from scipy.ndimage import gaussian_filter, median_filter, uniform_filter

        shape = (int(row.max()) + 2, int(column.max()) + 2)
        place = (np.rint(row).astype(np.intp), np.rint(column).astype(np.intp))
        hits = np.zeros((sector.max() + 1, *shape), np.float32)
        np.add.at(hits, (sector[owner], *place), 1)
        width = 2 * self.radius + 1
        near = np.stack([uniform_filter(h, width, mode="constant") * width**2 for h in hits])
        per_sector = np.bincount(sector, minlength=len(hits))
        often = (near / per_sector[:, None, None] > self.share / 2).mean(axis=0)
        total = near.sum(axis=0) / len(sector)
        around = median_filter(gaussian_filter(total, 1), 5 * width, mode="nearest")
        suspect = (total > self.share) & (often > 0.7)
        return np.asarray((suspect & (total > self.excess * around))[place])


def sectors(theta: Floats) -> NDArray[np.intp]:
    """(n,) the eighth of what was scanned that each projection lies in; with few, one for each."""
    rank = np.empty(len(theta), np.intp)
    rank[np.argsort(theta, kind="stable")] = np.arange(len(theta))
    return np.asarray(rank * min(8, len(theta)) // len(theta))
