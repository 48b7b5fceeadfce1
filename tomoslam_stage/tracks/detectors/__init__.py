"""Keypoint detectors, by the name a pipeline gives them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage.tracks.detectors.detector import Descriptors, Detector, Keypoints
from tomoslam_stage.tracks.detectors.sift import Sift
from tomoslam_stage.tracks.detectors.surf import Surf

if TYPE_CHECKING:
    from collections.abc import Mapping

DETECTORS: Mapping[str, type[Detector]] = {"sift": Sift, "surf": Surf}

__all__ = ["DETECTORS", "Descriptors", "Detector", "Keypoints", "Sift", "Surf"]
