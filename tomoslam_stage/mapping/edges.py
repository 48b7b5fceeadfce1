"""What sharp edges hide: line integrals through a blurred edge come out too small.

A detector blurs intensities, not line integrals. Where line integrals p change within its point
spread, of variance s^2 along each direction, what it records is to second order the blurred p less
``s^2 |grad p|^2 / 2``. Thick edge-on projections are full of that, face-on ones are not; no map
explains both.

Glover and Pelc, Medical Physics 7 (1980) 238; Joseph and Spital, Physics in Medicine and Biology
26 (1981) 473.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.mapping.maps import seen

if TYPE_CHECKING:
    from tomoslam_stage.products import Integers, Pixels, Scan


def edge_squares(scan: Scan, rows: Integers, usable: Integers) -> Pixels:
    """(r, n, column) squared gradient of the line integrals of `rows`, px^-2.

    A row stands for its neighbours where these are not among the `usable` ones. Noise is smoothed
    over three pixels in both directions.
    """
    above, below = (np.where(np.isin(near, usable), near, rows) for near in (rows - 1, rows + 1))
    upper, lower = (seen(scan.sinograms(near)) for near in (above, below))
    apart = np.maximum(below - above, 1)[:, None, None].astype(np.float32)
    by_row = (lower - upper) / apart
    by_column = np.gradient((upper + 2 * seen(scan.sinograms(rows)) + lower) / 4, axis=-1)
    return np.asarray(by_row**2 + by_column**2, np.float32)
