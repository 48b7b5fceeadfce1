"""Rows that are kept out of the refinement, to judge it by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.images import highpass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Integers, Scan

BANDS = (2, 5)
"""Fewest and most bands of rows held out."""
PROJECTIONS = 9
"""Projections looked at to see where there is something."""
CUTOFF = 8.0
"""px along the columns: what is smoother is no texture."""


@dataclass(frozen=True)
class Rows:
    """Which detector rows do what."""

    heldout: Integers
    """(r,) rows that only judge."""
    usable: NDArray[np.bool_]
    """(row,) rows that keypoints may come from: neither held out nor next to such a row."""


def hold_out(scan: Scan) -> Rows:
    """Hold out narrow bands of rows, spread over where the scan shows something.

    There is a band for each 16 rows, from two to five. A band has three rows from 240 rows on, and
    one below 160; up to three rows on either side are used by nobody, none below 40. So at most a
    tenth of 20 rows or more judge. Of a few rows a larger part judges; a single row does nothing
    else.
    """
    there = np.flatnonzero(textured(scan))
    bands = int(np.clip(scan.n_rows // 16, *BANDS))
    width = min(3, max(1, scan.n_rows // 80))
    guard = min(3, scan.n_rows // 40)
    # "lower" gives a row that is there; a mean of two might lie between two separate places.
    middles = np.quantile(there, (np.arange(bands) + 0.5) / bands, method="lower")
    starts = middles.astype(np.intp) - width // 2
    heldout = np.unique(starts[:, None] + np.arange(width))
    distance = np.abs(np.arange(scan.n_rows)[:, None] - heldout).min(axis=1)
    return Rows(heldout, distance > guard)


def textured(scan: Scan) -> NDArray[np.bool_]:
    """(row,) whether a row shows at least a tenth of the fine detail of the liveliest rows."""
    some = np.unique(np.linspace(0, scan.n_projections - 1, PROJECTIONS).astype(np.intp))
    detail: Floats = np.zeros(scan.n_rows)
    for index in some:
        detail += np.mean(np.square(highpass(scan.projection(int(index)), CUTOFF)), axis=-1)
    return np.asarray(detail >= 0.1 * np.quantile(detail, 0.9))
