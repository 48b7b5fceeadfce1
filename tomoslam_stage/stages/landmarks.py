"""Tracks and geometry improve each other: adjust, grow, adjust again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from tomoslam_stage.products import Geometry, Solve, Tracks
    from tomoslam_stage.refinement.landmarks import Adjusted, Landmarks
    from tomoslam_stage.tracks.tracking import Seen, Tracking

FEWEST = 10
"""Fewer features than this are no landmarks to go by."""


class Placed(NamedTuple):
    """Features that found their places."""

    adjusted: Adjusted
    """What they say."""
    tracks: Tracks
    """Their sightings, in the order of `adjusted.residuals`."""


@dataclass(frozen=True)
class Turns:
    """Adjusts the geometry to the tracks and grows the tracks with it, in turns."""

    tracking: Tracking
    """Grows tracks."""
    landmarks: Landmarks
    """Adjusts geometry and features."""
    rounds: int
    """At most so many adjustments."""
    settled_deg: float
    """Degrees: angles that change by less than this (rms) have settled."""

    def placed(self, seen: Seen, start: Geometry, solve: Solve) -> Placed | None:
        """Return the last adjustment and its tracks; None where there are too few features.

        Parameters
        ----------
        seen
            Keypoints and first tracks.
        start
            Geometry to begin with.
        solve
            The factor graph: change (k,) wanted at a geometry, given what sightings say there.
        """
        tracks, geometry = seen.tracks.sighted(self.tracking.growing.fewest), start
        result = None
        for turn in progress(range(self.rounds), "landmarks", self.rounds):
            if tracks.n_features < FEWEST:
                break
            adjusted = self.landmarks.adjust(tracks, geometry, solve)
            result = Placed(adjusted, tracks)
            moved = np.rad2deg(np.std(adjusted.geometry.theta - geometry.theta))
            geometry = adjusted.geometry
            if turn and moved < self.settled_deg:
                break
            if turn < self.rounds - 1:
                tracks = self.tracking.grow(seen.table, tracks, adjusted.features, geometry)
        return result
