"""SURF keypoints (Bay et al., Computer Vision and Image Understanding 110 (2008) 346)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.tracks.detectors.detector import Descriptors, Keypoints

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers, Pixels

GRID = (np.arange(20) - 9.5).astype(np.float64)
"""Samples across a descriptor, in units of the keypoint's size: 4 cells of 5."""


@method
class Surf:
    """SURF, upright, as in the paper.

    On a simulated board a triplet of projections at 10 degrees shares a tenth of the tracks that
    `Sift` gives it: take that instead, unless the published method is wanted.
    """

    keypoints: Annotated[int, Field(ge=10)] = 1000
    """The strongest keypoints kept in each projection."""
    noise_sigmas: Annotated[float, Field(ge=0)] = 1.0
    """Threshold of the blob response, in standard deviations of the projection's white noise."""
    octaves: Annotated[int, Field(ge=1, le=6)] = 3
    """Octaves of box sizes."""
    mended: bool = True
    """Undo the wrong sign of the interpolation between samples in mahotas 1.4, see `mended`. As it
    is, it places blobs 0.6 px off; mended, 0.02 px."""

    def detect(self, image: Pixels, noise: float) -> Keypoints:
        """Find the keypoints of `image`, see `Detector`."""
        grey = np.asarray(image * 255, dtype=np.float64)
        threshold = max((self.noise_sigmas * noise * 255) ** 2, 1e-3)
        found, octave = interest_points(grey, threshold, self.octaves)
        strongest = np.argsort(-found[:, 3], kind="stable")[: self.keypoints]
        place = found[strongest, :3]
        row, column, size = (mended(place, octave[strongest]) if self.mended else place).T
        return Keypoints(column, row, size, describe(grey, column, row, size))

    def at_most(self, keypoints: int) -> Surf:
        """Limit the number of keypoints, see `Detector`."""
        return replace(self, keypoints=min(self.keypoints, keypoints))

    def mirrored(self, descriptors: Pixels) -> Pixels:
        """Reverse the columns of cells and the sign of what changes along them, see `Detector`."""
        cells = descriptors.reshape(-1, 4, 4, 4)[:, :, ::-1]
        return np.asarray(cells * np.array([-1, 1, 1, 1], cells.dtype)).reshape(-1, 64)


def interest_points(image: Floats, threshold: float, octaves: int) -> tuple[Floats, Integers]:
    """(k, 5) row, column, size, response and sign of each blob; (k,) the octave it was found in.

    mahotas does not tell the octave: it is asked with one octave, with two, and so on. A blob of
    the first is in every answer, one of the last in a single one.
    """
    from mahotas.features import surf

    answers = [
        np.asarray(surf.interest_points(image, nr_octaves=1 + k, threshold=threshold), float)
        for k in range(octaves)
    ]
    answers = [answer.reshape(-1, 5) for answer in answers]
    found, answered = np.unique(np.concatenate(answers), axis=0, return_counts=True)
    return found, octaves - answered


def mended(place: Floats, octave: Integers) -> Floats:
    """(k, 3) rows, columns and sizes where mahotas would place blobs, were its sign right.

    The response is sampled every 2**o px in octave o, with boxes 3 (2**(o + 1) (i + 1) + 1) px wide
    and i = 0, 1, ...; a blob of that width has the size 2/15 of it. Between the samples mahotas
    goes as far as it should, but the other way: its `place` (k, 3) is mirrored about the sample.
    """
    step = 2.0**octave
    layer = (place[:, 2] / 0.4 - 1) / (2 * step) - 1
    samples = np.column_stack([place[:, :2] / step[:, None], layer])
    row, column, layer = (2 * np.rint(samples) - samples).T
    return np.column_stack([row * step, column * step, 0.4 * (2 * step * (layer + 1) + 1)])


def describe(image: Floats, column: Floats, row: Floats, size: Floats) -> Descriptors:
    """(k, 64) upright SURF descriptors (section 4 of Bay et al.): Haar responses in 4 x 4 cells.

    Each cell sums dx, dy, |dx| and |dy| over 5 x 5 samples, one keypoint size apart, under a
    Gaussian of 3.3 sizes.
    """
    integral = np.pad(image.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    x = column[:, None, None] + size[:, None, None] * GRID
    y = row[:, None, None] + size[:, None, None] * GRID[:, None]
    half = size[:, None, None]
    left = box(integral, (y, x - half / 2), (half, half / 2))
    right = box(integral, (y, x + half / 2), (half, half / 2))
    upper = box(integral, (y - half / 2, x), (half / 2, half))
    lower = box(integral, (y + half / 2, x), (half / 2, half))
    weight = np.exp(-(GRID**2 + GRID[:, None] ** 2) / (2 * 3.3**2))
    across, down = (right - left) * weight, (lower - upper) * weight
    sums = np.stack([across, down, np.abs(across), np.abs(down)], axis=-1)
    cells = sums.reshape(-1, 4, 5, 4, 5, 4).sum(axis=(2, 4)).reshape(-1, 64)
    length = np.linalg.norm(cells, axis=1, keepdims=True)
    return np.asarray(cells / np.maximum(length, 1e-9), np.float16)


def box(integral: Floats, centre: tuple[Floats, Floats], half: tuple[Floats, Floats]) -> Floats:
    """Sum of the pixels in boxes, their edges rounded to pixels and cut at the border."""
    rows, columns = integral.shape
    top, bottom = (np.rint(centre[0] + s * half[0] + 0.5) for s in (-1, 1))
    left, right = (np.rint(centre[1] + s * half[1] + 0.5) for s in (-1, 1))
    top, bottom = (np.clip(edge, 0, rows - 1).astype(np.intp) for edge in (top, bottom))
    left, right = (np.clip(edge, 0, columns - 1).astype(np.intp) for edge in (left, right))
    corners = integral[bottom, right] - integral[top, right] - integral[bottom, left]
    return np.asarray(corners + integral[top, left])
