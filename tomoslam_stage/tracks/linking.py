"""Matches between projections -> runs of keypoints -> tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import TURN, around, partners, within_turn, wrapped
from tomoslam_stage.products import Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tomoslam_stage.products import Floats, Integers
    from tomoslam_stage.tracks.detectors import Keypoints


@dataclass
class Links:
    """For every keypoint of the scan the one that follows it, and the one before, or -1."""

    next: Integers
    """(k,) number of the following keypoint."""
    previous: Integers
    """(k,) number of the keypoint before."""

    @classmethod
    def none(cls, count: int) -> Links:
        """No links among `count` keypoints."""
        return cls(np.full(count, -1, np.intp), np.full(count, -1, np.intp))

    def add(self, pairs: Integers) -> None:
        """Link `pairs` (p, 2), except where a keypoint is linked already; none is in two pairs."""
        free = (self.next[pairs[:, 0]] < 0) & (self.previous[pairs[:, 1]] < 0)
        here, there = pairs[free].T
        self.next[here] = there
        self.previous[there] = here

    def runs(self, longest: int) -> list[Integers]:
        """Keypoints that follow each other: runs of at least three and at most `longest`.

        What closes on itself is cut open anywhere.
        """
        linked = np.flatnonzero((self.next >= 0) | (self.previous >= 0))
        heads_first = np.concatenate([linked[self.previous[linked] < 0], linked])
        seen = np.zeros(len(self.next), bool)
        following = self.next.tolist()
        runs = []
        for head in heads_first.tolist():
            node, way = head, []
            while node >= 0 and not seen[node]:
                seen[node] = True
                way.append(node)
                node = following[node]
            runs += [way[cut : cut + longest] for cut in range(0, len(way), longest)]
        return [np.array(run) for run in runs if len(run) >= 3]


def neighbours(theta: Floats, away: int) -> Integers:
    """(p, 2) projections that are `away` places apart when ordered by their angles.

    The end of a full turn is followed by its beginning; across a gap in the turn nothing is linked.
    A gap is three times as long as the long ones among the steps; the short ones, between the same
    angles in different turns, say nothing about that.
    """
    order = around(theta)
    place = within_turn(theta)[order]
    one, step = (np.mod(np.roll(place, -further) - place, TURN) for further in (1, away))
    near = step <= 3 * away * max(float(np.quantile(one, 0.9, method="lower")), 1e-6)
    pairs = np.stack([order, np.roll(order, -away)], axis=1)
    return np.asarray(pairs[near & (pairs[:, 0] != pairs[:, 1])])


def a_step_apart(theta: Floats, step: float) -> Integers:
    """(p, 2) projections `step` radians apart, whole turns aside; none is twice in one column."""
    here = np.arange(len(theta))
    there = partners(theta, step)
    here, there = here[there >= 0], there[there >= 0]
    miss = np.abs(wrapped(theta[there] - theta[here] - step))
    nearest_first = np.lexsort((miss, there))
    once = np.unique(there[nearest_first], return_index=True)[1]
    kept = np.sort(nearest_first[once])
    return np.stack([here[kept], there[kept]], axis=1)


def tracks_of(runs: Sequence[Integers], keypoints: Sequence[Keypoints], fixed: int) -> Tracks:
    """Put runs of keypoint numbers into one table of sightings."""
    number = np.concatenate([np.empty(0, np.intp), *runs])
    owner = np.repeat(np.arange(len(keypoints)), [len(k) for k in keypoints])
    return Tracks(
        feature=np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        projection=owner[number],
        column=np.concatenate([k.column for k in keypoints])[number],
        row=np.concatenate([k.row for k in keypoints])[number],
        keypoints=np.array([len(k) for k in keypoints]),
        fixed_to_detector=fixed,
        keypoint=number,
    )
