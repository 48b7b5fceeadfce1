"""Pairs of keypoints in two projections that show the same feature (the paper's section 3)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.products import Floats, Integers, Pixels
from tomoslam_stage.tracks.detectors import Descriptors, Keypoints

CHUNK = 64
"""Keypoints of neighbouring rows that are compared at once."""


@method
class Matching:
    """Mutual nearest neighbours among the descriptors, on the same row, where geometry allows."""

    row_tolerance: Annotated[float, Field(gt=0)] = 2.0
    """Largest difference of rows, px (the paper's second condition)."""
    step_tolerance_deg: Annotated[float, Field(gt=0)] = 1.0
    """How wrong the recorded step may be: widens the columns where a match is looked for."""
    size_ratio: Annotated[float, Field(gt=1)] = 1.6
    """Largest ratio of the sizes of two matching keypoints."""
    distance: Annotated[float, Field(gt=0, le=2)] = 0.85
    """Largest distance between two matching descriptors of unit length."""

    def pairs(self, first: Keypoints, second: Keypoints, step: float, axis: float) -> Integers:
        """(p, 2) indices of matching keypoints, where the second lies `step` radians further on.

        Each is the other's nearest: matched forward and backward.
        """
        if len(first) == 0 or len(second) == 0:
            return np.empty((0, 2), np.intp)
        forward, backward = self._nearest(first, second, step, axis)
        ours = np.flatnonzero(forward >= 0)
        mutual = ours[backward[forward[ours]] == ours]
        return np.stack([mutual, forward[mutual]], axis=1)

    def _nearest(
        self, first: Keypoints, second: Keypoints, step: float, axis: float
    ) -> tuple[Integers, Integers]:
        """(k1,), (k2,) the nearest possible keypoint of the other projection, or -1.

        Only keypoints on nearby rows meet: both are gone through in the order of their rows.
        """
        forward, backward = np.full(len(first), -1), np.full(len(second), -1)
        nearest = np.full(len(second), self.distance, np.float32)
        reach = self._reach(first, second, step, axis)
        one, other = np.argsort(first.row), np.argsort(second.row)
        rows = second.row[other]
        for start in range(0, len(one), CHUNK):
            ours = one[start : start + CHUNK]
            low = np.searchsorted(rows, first.row[ours[0]] - self.row_tolerance)
            high = np.searchsorted(rows, first.row[ours[-1]] + self.row_tolerance, side="right")
            theirs = other[low:high]
            if len(theirs) == 0:
                continue
            here, there = first.chosen(ours), second.chosen(theirs)
            distance = distances(here.descriptor, there.descriptor)
            distance[~self._possible(here, there, reach[ours], (step, axis))] = np.inf
            best = distance.argmin(axis=1)
            near = distance[np.arange(len(ours)), best] < self.distance
            forward[ours[near]] = theirs[best[near]]
            closest = distance.argmin(axis=0)
            value = distance[closest, np.arange(len(theirs))]
            closer = value < nearest[theirs]
            nearest[theirs[closer]] = value[closer]
            backward[theirs[closer]] = ours[closest[closer]]
        return forward, backward

    def _reach(self, first: Keypoints, second: Keypoints, step: float, axis: float) -> Floats:
        """(k1,) px: how far from ``u1 cos(D)`` a feature can be after the step D.

        ``u2 = u1 cos(D) + w sin(D)``, where the depth w is at most the largest radius in sight.
        """
        u1, u2 = first.column - axis, second.column - axis
        radius = max(np.abs(u1).max(), np.abs(u2).max()) + 1
        depth = np.sqrt(radius**2 - u1**2)
        tolerance = radius * np.deg2rad(self.step_tolerance_deg) + 2
        return np.asarray(depth * np.sin(np.abs(step)) + tolerance)

    def _possible(
        self, first: Keypoints, second: Keypoints, reach: Floats, motion: tuple[float, float]
    ) -> NDArray[np.bool_]:
        """(k1, k2) whether row, size and column can be those of one feature."""
        step, axis = motion
        possible = np.abs(first.row[:, None] - second.row) <= self.row_tolerance
        ratio = np.log(first.size)[:, None] - np.log(second.size)
        possible &= np.abs(ratio) <= np.log(self.size_ratio)
        expected = (first.column - axis) * np.cos(step) + axis
        possible &= np.abs(expected[:, None] - second.column) <= reach[:, None]
        return np.asarray(possible)


def distances(first: Descriptors, second: Descriptors) -> Pixels:
    """(k1, k2) Euclidean distances between descriptors of unit length."""
    products = first.astype(np.float32) @ second.astype(np.float32).T
    return np.asarray(np.sqrt(np.maximum(2 - 2 * products, 0)))
