"""All keypoints of a scan as columns, to look features up in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Integers, Pixels, Tracks
    from tomoslam_stage.tracks.detectors import Descriptors, Keypoints

PAIRS = 1 << 15
"""Pairs of descriptors compared at once: all pairs of a long scan would take gigabytes."""
ALONE = 0.8
"""Distance of descriptors said of a sighting that has no neighbour to be compared with."""


@dataclass(frozen=True)
class KeypointTable:
    """The moving keypoints of all projections, one projection after the other."""

    projection: Integers
    """(k,) projection it was found in."""
    column: Floats
    """(k,) px."""
    row: Floats
    """(k,) px."""
    size: Floats
    """(k,) px, see `Keypoints`."""
    descriptor: Descriptors
    """(k, d) of unit length."""
    first: Integers
    """(n + 1,) number of the first keypoint of each projection, and of all keypoints."""
    mirrored: Callable[[Pixels], Pixels]
    """What the descriptors (k, d) would be in the mirror, see `Detector`."""

    @classmethod
    def of(
        cls, keypoints: Sequence[Keypoints], mirrored: Callable[[Pixels], Pixels]
    ) -> KeypointTable:
        """Put the keypoints of each projection into one table."""
        counts = [len(k) for k in keypoints]
        return cls(
            projection=np.repeat(np.arange(len(keypoints)), counts),
            column=np.concatenate([k.column for k in keypoints]),
            row=np.concatenate([k.row for k in keypoints]),
            size=np.concatenate([k.size for k in keypoints]),
            descriptor=np.concatenate([k.descriptor for k in keypoints]),
            first=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
            mirrored=mirrored,
        )

    def __len__(self) -> int:
        return len(self.column)

    @property
    def n_projections(self) -> int:
        """Number of projections."""
        return len(self.first) - 1

    def of_projection(self, projection: int) -> Integers:
        """(k,) numbers of the keypoints of one projection."""
        return np.arange(int(self.first[projection]), int(self.first[projection + 1]))

    def tracks(self, feature: Integers, keypoint: Integers, like: Tracks) -> Tracks:
        """Make tracks of `keypoint` (s,) numbers and the `feature` (s,) that each belongs to.

        The numbers of projections' keypoints and of those fixed to the detector are as in `like`.
        """
        made = replace(
            like,
            feature=feature,
            projection=self.projection[keypoint],
            column=self.column[keypoint],
            row=self.row[keypoint],
            keypoint=keypoint,
            unlike=np.empty((0, 2)),
        )
        return self.compared(made)

    def compared(self, tracks: Tracks) -> Tracks:
        """Add to `tracks` how little each sighting looks like the others of its feature."""
        distance = self._from_neighbours(tracks)
        size = np.log(self.size[tracks.keypoint])
        counts = np.maximum(np.bincount(tracks.feature), 1)
        usual = (np.bincount(tracks.feature, size) / counts)[tracks.feature]
        return replace(tracks, unlike=np.stack([distance, np.abs(size - usual)], axis=1))

    def distance(
        self, first: Integers, second: Integers, far: NDArray[np.bool_] | None = None
    ) -> Floats:
        """(p,) distance of the descriptors of pairs of keypoints.

        Where `far` (p,) holds, the second is seen from the far side, in the mirror.
        """
        distance = np.empty(len(first))
        for start in range(0, len(first), PAIRS):
            some = slice(start, start + PAIRS)
            one, other = self._exact(first[some]), self._exact(second[some])
            if far is not None:
                other[far[some]] = self.mirrored(other[far[some]])
            products = np.einsum("pd,pd->p", one, other)
            distance[some] = np.sqrt(np.maximum(2 - 2 * products, 0))
        return distance

    def _exact(self, keypoint: Integers) -> Pixels:
        """(p, d) descriptors in single precision; each is converted once, which takes longest."""
        once, where = np.unique(keypoint, return_inverse=True)
        return np.asarray(self.descriptor[once].astype(np.float32)[where])

    def _from_neighbours(self, tracks: Tracks) -> Floats:
        """(s,) distance of each descriptor from that of the more similar neighbour in the track."""
        apart = self.distance(tracks.keypoint[1:], tracks.keypoint[:-1])
        apart[tracks.feature[1:] != tracks.feature[:-1]] = np.nan
        ends = np.full(min(1, tracks.n_sightings), np.nan)
        nearer = np.fmin(np.concatenate([ends, apart]), np.concatenate([apart, ends]))
        return np.where(np.isfinite(nearer), nearer, ALONE)
