"""The station Scan -> Tracks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tomoslam_stage.methods import chosen_from, method
from tomoslam_stage.products import Features, Geometry, Scan, Tracks
from tomoslam_stage.tracks.detectors import DETECTORS, Detector, Sift
from tomoslam_stage.tracks.fixed import FixedToDetector
from tomoslam_stage.tracks.following import FOLLOWERS, Follower, Runs, Sights
from tomoslam_stage.tracks.growing import Growing, Known, numbered
from tomoslam_stage.tracks.keypoints import find_keypoints
from tomoslam_stage.tracks.linking import tracks_of
from tomoslam_stage.tracks.matching import Matching
from tomoslam_stage.tracks.table import KeypointTable

FEWEST = 50
"""Keypoints that a projection may give, however many projections there are."""


@dataclass(frozen=True)
class Seen:
    """What was seen in a scan."""

    table: KeypointTable
    """All keypoints that move."""
    tracks: Tracks
    """Those that were followed; their `keypoint` is a number in `table`."""


@method
class Tracking:
    """Detect keypoints, leave out those fixed to the detector, match and follow the others."""

    detector: Annotated[Detector, chosen_from(DETECTORS, "tracks.detector")] = field(
        default_factory=Sift
    )
    """What finds keypoints."""
    follower: Annotated[Follower, chosen_from(FOLLOWERS, "tracks.follower")] = field(
        default_factory=Runs
    )
    """How matches become tracks."""
    matching: Matching = field(default_factory=Matching)
    """How two projections are matched."""
    fixed: FixedToDetector = field(default_factory=FixedToDetector)
    """How dust and hot pixels are recognised."""
    background: Annotated[float, Field(gt=1)] = 4.0
    """What is smoother than a Gaussian of this width, px, is taken off before detection."""
    cache: Path | None = None
    """Folder in which keypoints are kept for another run; null: none."""
    most_keypoints: Annotated[int, Field(ge=1000)] = 1_000_000
    """At most so many in all projections, which bounds the memory: the more projections, the
    stronger the keypoints that each may give."""
    growing: Growing = field(default_factory=Growing)
    """How features are looked for once it is known where they are."""

    def track(self, scan: Scan, axis: float, usable: NDArray[np.bool_]) -> Tracks:
        """Follow the features of `scan`.

        Parameters
        ----------
        scan
            Its projections and recorded angles.
        axis
            Detector column of the rotation axis, px.
        usable
            (row,) whether keypoints may be taken from a row.
        """
        return self.see(scan, axis, usable).tracks

    def see(self, scan: Scan, axis: float, usable: NDArray[np.bool_]) -> Seen:
        """Follow the features of `scan`, see `track`, and keep the keypoints to look them up."""
        detector = self.detector.at_most(max(FEWEST, self.most_keypoints // scan.n_projections))
        keypoints = find_keypoints(scan, detector, self.background, usable, self.cache)
        fixed = self.fixed.find(keypoints, scan.theta)
        for index, mask in enumerate(fixed):
            keypoints[index] = keypoints[index].chosen(~mask)
        runs = self.follower.runs(Sights(keypoints, scan.theta, axis, self.matching))
        tracks = tracks_of(runs, keypoints, sum(int(mask.sum()) for mask in fixed))
        table = KeypointTable.of(keypoints, detector.mirrored)
        return Seen(table, table.compared(tracks))

    def grow(
        self, table: KeypointTable, tracks: Tracks, features: Features, geometry: Geometry
    ) -> Tracks:
        """Look for all features of `tracks` in every projection.

        Parameters
        ----------
        table
            The keypoints, see `see`.
        tracks
            The sightings so far, with the numbers of their keypoints.
        features
            Where the features of `tracks` lie, in the order of their numbers.
        geometry
            Where the projections look from.
        """
        return self.growing.grow(Known(table, numbered(tracks), features, geometry))
