"""Scan -> Tracks: keypoints, their matches, and features followed along the turn.

To add a detector, write it in `detectors`; to add a way of following, in `following`.
"""

from tomoslam_stage.tracks.detectors import DETECTORS
from tomoslam_stage.tracks.following import FOLLOWERS
from tomoslam_stage.tracks.halves import halves
from tomoslam_stage.tracks.tracking import Seen, Tracking

__all__ = ["DETECTORS", "FOLLOWERS", "Seen", "Tracking", "halves"]
