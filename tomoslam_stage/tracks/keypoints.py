"""Keypoints of every projection of a scan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.images import bandpass, noise_sigma
from tomoslam_stage.parallel import parallel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Pixels, Scan
    from tomoslam_stage.tracks.detectors import Detector, Keypoints


def find_keypoints(
    scan: Scan, detector: Detector, background: float, usable: NDArray[np.bool_]
) -> list[Keypoints]:
    """Keypoints of each projection, on the `usable` (row,) rows.

    What is smoother than a Gaussian of `background` px is taken off first.
    """

    def found(index: int) -> Keypoints:
        detail = bandpass(scan.projection(index), 0, background)
        image, scale = stretched(detail)
        keypoints = detector.detect(image, noise_sigma(detail) * scale)
        row = np.clip(np.rint(keypoints.row), 0, scan.n_rows - 1).astype(np.intp)
        return keypoints.chosen(usable[row])

    return list(parallel(found, range(scan.n_projections), "finding keypoints"))


def stretched(detail: Pixels) -> tuple[Pixels, float]:
    """Stretch a band-passed projection to 0..1 around 0.5, and say by how much it was scaled.

    All but one in a thousand pixels of either sign fit; the brightest specks are cut.
    """
    reach = float(np.quantile(np.abs(detail), 0.998))
    scale = 0.5 / reach if reach > 0 else 1.0
    return np.clip(detail * np.float32(scale) + np.float32(0.5), 0, 1), scale
