"""Two disjoint halves of the tracks, to see how far the angles from either agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Tracks

BANDS = 16
"""Bands of rows on the detector, given to the halves in turn."""


def halves(tracks: Tracks, n_rows: int) -> tuple[Tracks, Tracks]:
    """Split `tracks` by the rows of their features, band by band.

    A feature stays on its row, so no feature, and hardly any pixel, speaks in both halves.
    """
    band = np.floor(tracks.row * BANDS / n_rows).astype(np.intp)
    first = np.zeros(tracks.feature.max(initial=-1) + 1, np.intp)
    # The first sighting of a feature decides for all of them.
    first[tracks.feature[::-1]] = band[::-1]
    even = first[tracks.feature] % 2 == 0
    return tracks.chosen(even), tracks.chosen(~even)
