"""The station Scan -> Tracks as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tomoslam_stage.products import Pixels
from tomoslam_stage.scans import scan_of
from tomoslam_stage.tracks import Tracking
from tomoslam_stage.tracks.detectors import DETECTORS
from tomoslam_stage.tracks.tracking import FEWEST

N, ROWS, COLUMNS = 12, 192, 256


@pytest.mark.parametrize("name", DETECTORS)
@pytest.mark.parametrize(("most", "each"), [(1200, 100), (10**6, 10**6)])
def test_projections_share_the_keypoints_that_there_may_be(name: str, most: int, each: int) -> None:
    scan = scan_of(textured(N), np.arange(N) / 10)
    detector = DETECTORS[name](keypoints=120)
    seen = Tracking(detector=detector, most_keypoints=most).see(scan, 64.0, np.ones(ROWS, bool))
    counts = seen.tracks.keypoints + seen.tracks.fixed_to_detector
    assert counts.max() == min(each, 120)


def test_every_projection_gives_some_keypoints_however_many_there_are() -> None:
    scan = scan_of(textured(40), np.arange(40) / 10)
    seen = Tracking(most_keypoints=1000).see(scan, 64.0, np.ones(ROWS, bool))
    assert np.median(seen.tracks.keypoints) > 0.9 * FEWEST


def textured(n: int) -> Pixels:
    """(n, row, column) projections full of keypoints, none of them twice in one place."""
    white = np.random.default_rng(5).normal(0, 1, (n, ROWS, COLUMNS)).astype(np.float32)
    return np.asarray(gaussian_filter(white, (0, 1.5, 1.5)))
