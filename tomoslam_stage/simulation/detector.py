"""A scintillator and a camera: what they make of line integrals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.products import Floats

FULL = np.iinfo(np.uint16).max

NotNegative = Annotated[float, Field(ge=0)]
Number = Annotated[int, Field(ge=0)]


@method
class Detector:
    """An area detector with a 16 bit camera."""

    counts: Annotated[float, Field(gt=0)] = 20_000.0
    """Counts in an open pixel in the middle of the beam."""
    photons: Annotated[float, Field(gt=0)] = 1.0
    """Photons that make a count: more of them, and the same counts are less noisy."""
    blur: NotNegative = 0.6
    """px: standard deviation of the point spread of the scintillator."""
    beam_fall: Annotated[float, Field(ge=0, lt=1)] = 0.2
    """Share of the beam that is missing at the upper and lower edge."""
    gain: NotNegative = 0.03
    """Standard deviation of the sensitivity from pixel to pixel."""
    offset: NotNegative = 100.0
    """Counts without any light."""
    readout: NotNegative = 4.0
    """Counts: standard deviation of the readout noise."""
    dust: Number = 10
    """Specks on the scintillator."""
    dust_depth: Annotated[float, Field(ge=0, lt=1)] = 0.25
    """Share of the light that the darkest speck takes."""
    dust_shift: Annotated[float, Field(ge=0, le=1)] = 0.4
    """Share of a speck that came after the flats, so that flat-fielding leaves it."""
    hot: Number = 8
    """Hot pixels; flat-fielding leaves `dust_shift` of them too."""
    whites: Annotated[int, Field(ge=1)] = 10
    """Flats taken."""
    darks: Annotated[int, Field(ge=1)] = 10
    """Darks taken."""


@dataclass(frozen=True)
class Camera:
    """One detector: its settings and the pattern that is fixed to its pixels."""

    detector: Detector
    beam: Floats
    """(row, column) counts a projection's open beam leaves after the dust."""
    beam_before: Floats
    """(row, column) the same while the flats were taken."""
    gain: Floats
    """(row, column) sensitivity, around 1."""
    base: Floats
    """(row, column) counts without light during the scan."""
    base_before: Floats
    """(row, column) the same while flats and darks were taken."""

    def projection(self, line_integrals: Floats, rng: np.random.Generator) -> NDArray[np.uint16]:
        """(row, column) counts behind an object with these line integrals."""
        from scipy.ndimage import gaussian_filter

        through = gaussian_filter(np.exp(-line_integrals), self.detector.blur, mode="nearest")
        return self._read(self.beam * through, self.base, rng)

    def whites(self, rng: np.random.Generator) -> NDArray[np.uint16]:
        """(white, row, column) counts of the open beam."""
        light = np.broadcast_to(self.beam_before, (self.detector.whites, *self.gain.shape))
        return self._read(light, self.base_before, rng)

    def darks(self, rng: np.random.Generator) -> NDArray[np.uint16]:
        """(dark, row, column) counts without any light."""
        light = np.zeros((self.detector.darks, *self.gain.shape))
        return self._read(light, self.base_before, rng)

    def _read(self, light: Floats, base: Floats, rng: np.random.Generator) -> NDArray[np.uint16]:
        photons = self.detector.photons
        counts = rng.poisson(light * photons) / photons * self.gain + base
        counts += rng.normal(0, self.detector.readout, light.shape)
        return np.clip(np.rint(counts), 0, FULL).astype(np.uint16)


def camera(detector: Detector, shape: tuple[int, int], rng: np.random.Generator) -> Camera:
    """Make a camera of `shape` (rows, columns) px with its own gain, dust and hot pixels."""
    rows, _ = shape
    edge = np.linspace(-1, 1, rows)[:, None] ** 2
    beam = detector.counts * (1 - detector.beam_fall * edge) * np.ones(shape)
    gain = np.maximum(rng.normal(1, detector.gain, shape), 0.1)
    dust, hot = _dust(detector, shape, rng), _hot_pixels(detector, shape, rng)
    before = 1 - detector.dust_shift
    return Camera(
        detector=detector,
        beam=beam * (1 - dust),
        beam_before=beam * (1 - before * dust),
        gain=gain,
        base=detector.offset + hot,
        base_before=detector.offset + before * hot,
    )


def _dust(detector: Detector, shape: tuple[int, int], rng: np.random.Generator) -> Floats:
    """(row, column) share of the light that soft round specks take."""
    row, column = np.indices(shape)
    left = np.ones(shape)
    for _ in range(detector.dust):
        at_row, at_column = rng.uniform(0, shape)
        radius, depth = rng.uniform(1.5, 4), rng.uniform(0.4, 1) * detector.dust_depth
        distance = np.hypot(row - at_row, column - at_column)
        left *= 1 - depth / 2 * (1 + np.tanh((radius - distance) / 0.8))
    return 1 - left


def _hot_pixels(detector: Detector, shape: tuple[int, int], rng: np.random.Generator) -> Floats:
    """(row, column) counts that hot pixels add, a tenth to a half of the open beam."""
    hot = np.zeros(shape)
    where = rng.integers(0, shape, (detector.hot, 2))
    hot[tuple(where.T)] = rng.uniform(0.1, 0.5, detector.hot) * detector.counts
    return hot
