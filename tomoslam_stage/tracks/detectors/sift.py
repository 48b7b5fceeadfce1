"""SIFT keypoints (Lowe, IJCV 60 (2004) 91)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.tracks.detectors.detector import Keypoints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cv2 import KeyPoint

    from tomoslam_stage.products import Pixels

ROW, COLUMN, ORIENTATION = np.indices((4, 4, 8))
MIRROR = ((4 * ROW + 3 - COLUMN) * 8 + (4 - ORIENTATION) % 8).ravel()
"""(128,) Where the histograms (row, column, orientation) of a mirrored patch are found."""


@method
class Sift:
    """SIFT, upright. The default: its columns scatter by 0.07 to 0.15 px on radiographs.

    The contrast threshold follows the noise of each projection, so that neither a faint foam nor a
    strong board needs a setting of its own.
    """

    keypoints: Annotated[int, Field(ge=10)] = 1000
    """The strongest keypoints kept in each projection."""
    noise_sigmas: Annotated[float, Field(ge=0)] = 0.2
    """Contrast threshold, in standard deviations of the projection's white noise."""
    edge_ratio: Annotated[float, Field(gt=1)] = 10.0
    """Largest ratio of the principal curvatures: larger keeps more of what lies on edges."""
    sigma: Annotated[float, Field(gt=0.5)] = 1.2
    """Blur of the first octave, px."""

    def detect(self, image: Pixels, noise: float) -> Keypoints:
        """Find the keypoints of `image`, see `Detector`."""
        import cv2

        # OpenCV divides the threshold by the number of layers in an octave; that is undone here.
        layers = 3
        sift = cv2.SIFT.create(
            # OpenCV counts a keypoint once for each orientation: seldom more than four times.
            nfeatures=4 * self.keypoints,
            nOctaveLayers=layers,
            contrastThreshold=max(layers * self.noise_sigmas * noise, 1e-4),
            edgeThreshold=self.edge_ratio,
            sigma=self.sigma,
            # Without it all positions are off by about 0.2 px.
            enable_precise_upscale=True,
        )
        grey = np.clip(np.rint(image * 255), 0, 255).astype(np.uint8)
        found = distinct(sift.detect(grey, None))[: self.keypoints]
        for keypoint in found:
            keypoint.angle = 0.0
        if not found:
            return Keypoints(*(np.empty(0),) * 3, np.empty((0, 128), np.float16))
        described, descriptor = sift.compute(grey, found)
        column, row = np.array([keypoint.pt for keypoint in described], float).T
        size = np.array([keypoint.size for keypoint in described], float) / 2
        length = np.linalg.norm(descriptor, axis=1, keepdims=True)
        unit = (descriptor / np.maximum(length, 1e-6)).astype(np.float16)
        return Keypoints(column, row, size, unit)

    def at_most(self, keypoints: int) -> Sift:
        """Limit the number of keypoints, see `Detector`."""
        return replace(self, keypoints=min(self.keypoints, keypoints))

    def mirrored(self, descriptors: Pixels) -> Pixels:
        """Reverse the columns of cells and turn the orientations round, see `Detector`."""
        return descriptors[:, MIRROR]


def distinct(found: Sequence[KeyPoint]) -> list[KeyPoint]:
    """Drop repeats: SIFT returns a keypoint once for each orientation it sees in it."""
    places = {(k.pt, k.octave): k for k in sorted(found, key=lambda k: k.response)}
    return sorted(places.values(), key=lambda k: -k.response)
