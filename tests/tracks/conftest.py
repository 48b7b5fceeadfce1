"""Features that turn with an object, and keypoints that show them without error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from tomoslam_stage.tracks.detectors import Keypoints
from tomoslam_stage.tracks.following import Sights
from tomoslam_stage.tracks.matching import Matching


@dataclass(frozen=True)
class Scene:
    """Keypoints of known features in every projection."""

    sights: Sights
    truth: list[np.ndarray]
    """For each projection the feature of each of its keypoints."""

    @property
    def feature(self) -> np.ndarray:
        """(k,) feature of each keypoint, all projections after one another."""
        return np.concatenate(self.truth)


def unit(descriptors: np.ndarray) -> np.ndarray:
    """(k, d) of length one, in half precision."""
    return (descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)).astype(np.float16)


def turning(theta: np.ndarray, features: int = 25, seed: int = 3, axis: float = 83.4) -> Scene:
    """See `features` random points about `axis` at `theta`, in a new random order each time."""
    rng = np.random.default_rng(seed)
    radius, phase = 70 * np.sqrt(rng.uniform(0.01, 1, features)), rng.uniform(0, 6.3, features)
    x, z, y = radius * np.cos(phase), radius * np.sin(phase), rng.uniform(5, 120, features)
    size, descriptor = rng.uniform(1.5, 4, features), unit(rng.normal(size=(features, 32)))
    keypoints, truth = [], []
    for angle in theta:
        order = rng.permutation(features)
        column = x * np.cos(angle) + z * np.sin(angle) + axis
        keypoints.append(Keypoints(column[order], y[order], size[order], descriptor[order]))
        truth.append(order)
    return Scene(Sights(keypoints, np.asarray(theta), axis, Matching()), truth)


@pytest.fixture
def scene() -> Callable[..., Scene]:
    """Make a `Scene` of the angles and, if wanted, so many features."""
    return turning
