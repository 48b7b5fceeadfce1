"""From what the detector stored to line integrals: counts, transmission, or integrals already."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.selection import BLOCK_PIXELS, filled, gather

if TYPE_CHECKING:
    from h5py import File
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Integers, Pixels, Values
    from tomoslam_stage.scans.contents import Contents, References

LEAST_TRANSMISSION = 1e-4
"""Pixels darker than this count as just this dark: a line integral of 9.2, not infinity."""
WEAK_PIXEL = 0.02
"""A pixel that sees less than this share of the median beam is dead."""


@dataclass(frozen=True)
class LineIntegrals:
    """The file holds line integrals; only gaps are filled."""

    kind: ClassVar[Values] = "line_integrals"

    def __call__(self, raw: Pixels, _projections: Integers, _rows: Integers) -> Pixels:
        """Return (p, r, c) line integrals."""
        return filled(raw)


@dataclass(frozen=True)
class Transmission:
    """The file holds the share of the beam that came through."""

    kind: ClassVar[Values] = "transmission"

    air: float = 1.0
    """Transmission beside the object; it becomes a line integral of 0."""

    def __call__(self, raw: Pixels, _projections: Integers, _rows: Integers) -> Pixels:
        """Return (p, r, c) line integrals."""
        raw /= np.float32(self.air)
        return _minus_log(raw)


@dataclass(frozen=True)
class Counts:
    """The file holds raw counts, with flats and, usually, darks.

    Flats taken at several moments of the scan are interpolated linearly between them.
    """

    kind: ClassVar[Values] = "counts"

    positions: Floats
    """(g,) frames of the data taken before each group of flats; increasing."""
    beams: Pixels
    """(g, rows, columns) mean flat of each group minus the dark."""
    dark: Pixels
    """(rows, columns)"""
    typical_beam: float
    """Median of flat minus dark, counts."""

    def __call__(self, raw: Pixels, projections: Integers, rows: Integers) -> Pixels:
        """Return (p, r, c) line integrals."""
        beam = self.beams[:, rows]
        raw -= self.dark[rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            raw /= self._along_the_scan(beam, projections)
        raw[:, self._dead(beam)] = np.nan
        return _minus_log(raw)

    def _along_the_scan(self, beam: Pixels, projections: Integers) -> Pixels:
        """Return the beam (p, r, c), or (1, r, c), as it was when the projections were taken."""
        if len(self.positions) == 1:
            return beam
        moment = np.clip(projections, self.positions[0], self.positions[-1])
        later = np.clip(np.searchsorted(self.positions, moment), 1, len(self.positions) - 1)
        start, end = self.positions[later - 1], self.positions[later]
        weight = ((moment - start) / (end - start)).astype(np.float32)[:, None, None]
        return beam[later - 1] * (1 - weight) + beam[later] * weight

    def _dead(self, beam: Pixels) -> NDArray[np.bool_]:
        """Say which pixels (r, c) see no beam, or always see one (hot: the dark is as bright)."""
        return np.logical_not((beam > WEAK_PIXEL * self.typical_beam).all(axis=0))


def _minus_log(transmission: Pixels) -> Pixels:
    """Return line integrals, finite everywhere; in place."""
    np.maximum(transmission, np.float32(LEAST_TRANSMISSION), out=transmission)
    np.log(transmission, out=transmission)
    np.negative(transmission, out=transmission)
    return filled(transmission)


def read_counts(contents: Contents, file: File) -> Counts:
    """Average the flats, of which there are some, and the darks of an open file.

    Raises
    ------
    ScanError
        If the flats are no brighter than the darks.
    """
    positions = np.unique(contents.flat_positions)
    groups = [np.flatnonzero(np.asarray(contents.flat_positions) == p) for p in positions]
    means = np.stack([_mean(contents.flats, file, group) for group in groups])
    dark = np.zeros_like(means[0]) if contents.darks is None else _mean(contents.darks, file)
    beams = means - dark
    typical = float(np.median(beams[np.isfinite(beams)])) if np.isfinite(beams).any() else np.nan
    if not typical > 0:
        raise ScanError(
            contents.path.name,
            f"the median of the flats minus the darks is {typical:.4g} counts; "
            "flats brighter than the darks are needed.",
            "Check which of the two the beam was off for, or pass --set load_scan.kind=...",
        )
    return Counts(positions.astype(np.float64), beams, dark, typical)


def _mean(some: References | None, file: File, group: Integers | None = None) -> Pixels:
    """(rows, columns) mean of a `group` of flats or darks, or of all."""
    if some is None:
        raise ValueError("there are none")
    chosen = group if some.frames is None else some.frames[slice(None) if group is None else group]
    return average(file[some.place], chosen)


def average(frames: Any, chosen: Integers | None = None) -> Pixels:
    """Average frames; of five or more, the brightest and the darkest value of each pixel are left.

    A single bad frame (beam dump, cosmic ray) then leaves no mark, at hardly any cost in noise.

    Parameters
    ----------
    frames
        (f, rows, columns), or (rows, columns).
    chosen
        Indices of the frames, increasing; all where not given.
    """
    if len(frames.shape) == 2:
        return np.asarray(frames[()], np.float32)
    use = np.arange(frames.shape[0]) if chosen is None else chosen
    rows, columns = frames.shape[1:]
    out = np.empty((rows, columns), np.float32)
    height = max(1, BLOCK_PIXELS // (len(use) * columns))
    for top in range(0, rows, height):
        block = gather(frames, use, np.arange(top, min(top + height, rows)))
        if len(use) >= 5:
            block = np.sort(block, axis=0)[1:-1]
        out[top : top + height] = block.mean(axis=0, dtype=np.float64)
    return out
