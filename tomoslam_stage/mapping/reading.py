"""How rows of a scan are read for the map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.mapping.blurring import hidden
from tomoslam_stage.mapping.looking import Observed, left_out_errors, truncated
from tomoslam_stage.parallel import parallel
from tomoslam_stage.reprojection import binned

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tomoslam_stage.products import Geometry, Integers, Pixels, Scan

TOGETHER = 8
"""Projections read at a time."""
USUAL = 0.02
"""Strength of the map's prior while the blur is looked for."""


@dataclass(frozen=True)
class Reading:
    """What may be read of a scan, and how."""

    scan: Scan
    """Line integrals."""
    usable: Integers
    """(r,) rows that may be looked at, in order."""
    binning: int
    """Columns made one."""
    cutoff: float
    """Px of the scan: what is smoother along the columns does not count."""
    wide: float
    """Side of the map where the object reaches beyond the detector, in widths of it."""

    def observed(self, rows: Integers, blur: float = 0.0) -> Observed:
        """Read some of the `usable` rows; `blur`, px, is that of the intensities, to be mended.

        A row is smoothed over its neighbours where these are not read for themselves.
        """
        smooth = 2 * len(rows) <= len(self.usable)
        sinograms = self._mended(rows, blur, smooth) if blur else self._read(rows, smooth)
        extent = self.wide if truncated(sinograms) else 1.0
        return Observed(sinograms, rows, self.binning, self.cutoff, extent, blur=blur)

    def _read(self, rows: Integers, smooth: bool) -> Pixels:
        """(r, n, column) as recorded."""
        near = self._near(rows, smooth)
        needed, where = np.unique(near, return_inverse=True)
        sinograms = binned(self.scan.sinograms(needed), self.binning)
        return averaged([sinograms[each] for each in where.reshape(near.shape)])

    def _mended(self, rows: Integers, blur: float, smooth: bool) -> Pixels:
        """(r, n, column) with what the blur hides, found from whole projections."""
        source, everyone = self.scan.source, np.arange(self.scan.n_rows)
        near, instead = self._near(rows, smooth), self._instead(everyone)

        def some(projections: Integers) -> Pixels:
            images = source.read(projections, everyone)[:, instead]
            images += hidden(images, blur)
            return binned(averaged([images[:, each] for each in near]), self.binning)

        starts = range(0, self.scan.n_projections, TOGETHER)
        blocks = [np.arange(s, min(s + TOGETHER, self.scan.n_projections)) for s in starts]
        return np.concatenate(list(parallel(some, blocks))).transpose(1, 0, 2).copy()

    def _near(self, rows: Integers, smooth: bool) -> Integers:
        """(k, r) rows whose mean stands for each of `rows`."""
        return self._instead(rows + np.array([-1, 0, 0, 1] if smooth else [0])[:, None])

    def _instead(self, rows: Integers) -> Integers:
        """(...) the usable rows that are nearest to `rows`."""
        middles = (self.usable[1:] + self.usable[:-1]) / 2
        return self.usable[np.searchsorted(middles, rows)]


def likeliest(
    reading: Reading, rows: Integers, geometry: Geometry, blurs: Iterable[float]
) -> float:
    """Return the blur of intensities, px, of the least error on projections left out."""
    tried = ((blur, replace(reading.observed(rows, blur), strength=USUAL)) for blur in blurs)
    errors = left_out_errors(geometry, tried, 1.02)
    return min(errors, key=lambda blur: errors[blur])


def averaged(parts: list[Pixels]) -> Pixels:
    """Return the mean of `parts`, which are alike."""
    return np.asarray(sum(parts[1:], parts[0]) / np.float32(len(parts)), np.float32)
