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
    from collections.abc import Iterable, Mapping

    from tomoslam_stage.products import Geometry, Integers, Pixels, Scan

TOGETHER = 8
"""Projections read at a time."""
SMOOTHING, ALONE = {-1: 0.25, 0: 0.5, 1: 0.25}, {0: 1.0}
"""Weights of a row and its neighbours, by how far below they are."""


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
        weights = SMOOTHING if 2 * len(rows) <= len(self.usable) else ALONE
        sinograms = self._mended(rows, blur, weights) if blur else self._read(rows, weights)
        extent = self.wide if truncated(sinograms) else 1.0
        left = float(np.square(list(weights.values())).sum())
        return Observed(
            sinograms, rows, self.binning, self.cutoff, extent, blur=blur, noise_left=left
        )

    def mended(self, rows: Observed, blur: float) -> Observed:
        """Read the same rows, and make maps of them in the same way, with another blur mended."""
        again = self.observed(rows.rows, blur)
        return replace(again, strength=rows.strength, faintest=rows.faintest)

    def _read(self, rows: Integers, weights: Mapping[int, float]) -> Pixels:
        """(r, n, column) as recorded."""
        near = {away: self._instead(rows + away) for away in weights}
        needed = np.unique(list(near.values()))
        sinograms = binned(self.scan.sinograms(needed), self.binning)
        parts = (w * sinograms[np.searchsorted(needed, near[away])] for away, w in weights.items())
        return np.asarray(sum(parts), np.float32)

    def _mended(self, rows: Integers, blur: float, weights: Mapping[int, float]) -> Pixels:
        """(r, n, column) with what the blur hides, found from whole projections."""
        source, everyone = self.scan.source, np.arange(self.scan.n_rows)
        instead = self._instead(everyone)

        def some(projections: Integers) -> Pixels:
            images = source.read(projections, everyone)[:, instead]
            images += hidden(images, blur)
            parts = (w * images[:, self._instead(rows + away)] for away, w in weights.items())
            return binned(np.asarray(sum(parts), np.float32), self.binning)

        starts = range(0, self.scan.n_projections, TOGETHER)
        blocks = [np.arange(s, min(s + TOGETHER, self.scan.n_projections)) for s in starts]
        return np.concatenate(list(parallel(some, blocks))).transpose(1, 0, 2).copy()

    def _instead(self, rows: Integers) -> Integers:
        """(...) the usable rows that are nearest to `rows`."""
        middles = (self.usable[1:] + self.usable[:-1]) / 2
        return self.usable[np.searchsorted(middles, rows)]


def likeliest(
    reading: Reading, rows: Observed, geometry: Geometry, blurs: Iterable[float]
) -> float:
    """Return the blur of intensities, px, of the least error on projections left out.

    Or the largest within half a percent of that: in the dark, where it matters, mending raises
    noise, which speaks against it.
    """
    tried = ((blur, reading.mended(rows, blur)) for blur in blurs)
    errors = left_out_errors(geometry, tried, 1.02)
    least = min(errors.values())
    return max(blur for blur, error in errors.items() if error <= 1.005 * least)
