"""Keypoints of every projection of a scan."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.images import bandpass, noise_sigma
from tomoslam_stage.parallel import parallel
from tomoslam_stage.tracks.caching import KeypointCache

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tomoslam_stage.products import Pixels, Scan
    from tomoslam_stage.tracks.detectors import Detector, Keypoints


def find_keypoints(
    scan: Scan,
    detector: Detector,
    background: float,
    usable: NDArray[np.bool_],
    cache: Path | None = None,
) -> list[Keypoints]:
    """Keypoints of each projection, on the `usable` (row,) rows.

    What is smoother than a Gaussian of `background` px is taken off first. Where there is a folder
    `cache`, keypoints are kept in it, and taken from it.
    """

    def detected(projection: Pixels) -> Keypoints:
        detail = bandpass(projection, 0, background)
        image, scale = stretched(detail)
        keypoints = detector.detect(image, noise_sigma(detail) * scale)
        row = np.clip(np.rint(keypoints.row), 0, scan.n_rows - 1).astype(np.intp)
        return keypoints.chosen(usable[row])

    def found(index: int) -> Keypoints:
        projection = scan.projection(index)
        if kept is None:
            return detected(projection)
        return kept.keypoints(int(scan.frames[index]), projection, partial(detected, projection))

    made_with = f"{detector!r} {background!r} {np.packbits(usable).tobytes().hex()}"
    kept = None if cache is None else KeypointCache.at(cache, scan.name, made_with)
    everything = list(parallel(found, range(scan.n_projections), "finding keypoints"))
    if kept is not None:
        kept.say()
    return everything


def stretched(detail: Pixels) -> tuple[Pixels, float]:
    """Stretch a band-passed projection to 0..1 around 0.5, and say by how much it was scaled.

    All but one in a thousand pixels of either sign fit; the brightest specks are cut.
    """
    reach = float(np.quantile(np.abs(detail), 0.998))
    scale = 0.5 / reach if reach > 0 else 1.0
    return np.clip(detail * np.float32(scale) + np.float32(0.5), 0, 1), scale
