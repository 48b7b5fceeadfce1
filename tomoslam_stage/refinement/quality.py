"""How far each sighting can be trusted, from what can be seen of it.

The logarithm of the squared residual is regressed on how little the sighting looks like its track,
how alone it stands, how far it is off the row of its track, and how short the track is. What this
predicts is the sighting's own variance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import within_turn

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats
    from tomoslam_stage.refinement.sightings import Sightings

LOG_CHI2 = -1.27
"""Mean logarithm of a chi-square variable of one degree of freedom."""
SUPPORT_STEPS = 5.5
"""Usual steps between projections within which sightings of a track support each other."""
ROW_SIGMA_PX = 0.3
"""Rows of a track that differ by more than this are hardly counted for its mean."""
MOST_UNLIKE = np.array([np.inf, 0.5])
"""Largest values of `Tracks.unlike` that make a difference."""
MOST_OFF_ROW_PX = 1.5
"""Largest distance from the row of the track that makes a difference."""
RIDGE = 1e-3
"""Holds the regression, relative to the number of sightings."""
VARIANCES_PX2 = (9.0, 4.0)
"""Largest squared residual that is asked, and largest variance that is answered."""


def signs(sightings: Sightings, theta: Floats) -> Floats:
    """(s, c) standardised signs that sightings are good or bad, their squares, and a constant."""
    f, counts = sightings.feature, sightings.counts
    off_row = np.minimum(np.abs(sightings.row - usual_row(sightings)[f]), MOST_OFF_ROW_PX)
    scatter = np.sqrt(sightings.sums(off_row**2) / counts)[f]
    unlike = np.minimum(sightings.unlike, MOST_UNLIKE[: sightings.unlike.shape[1]])
    support = np.log1p(_support(sightings, theta))
    x = np.column_stack([unlike, support, off_row, scatter, np.log(counts[f])])
    z = np.clip((x - x.mean(axis=0)) / (x.std(axis=0) + 1e-9), -3, 3)
    return np.column_stack([np.ones(len(z)), z, z**2 - 1])


def predicted_sigma(signs: Floats, residuals: Floats, leverage: Floats, floor: float) -> Floats:
    """(s,) px: the standard deviation of each sighting, as `signs` (s, c) predict it.

    A feature gives way to its sightings; `leverage` (s,) is the part of the variance that this
    takes from each residual. No sighting is better than `floor` px.
    """
    squares = residuals**2 / np.maximum(1 - leverage, 0.05) + floor**2
    most_asked, most_answered = VARIANCES_PX2
    # What no good sighting could have is a mismatch: the robust weight deals with it.
    wanted = np.minimum(np.log(squares) - LOG_CHI2, np.log(most_asked))
    held = np.full(signs.shape[1], RIDGE * len(signs))
    held[0] = 0
    normal = signs.T @ signs + np.diag(held)
    said = signs @ np.linalg.solve(normal, signs.T @ wanted)
    limits = 2 * np.log(floor), np.log(most_answered)
    return np.asarray(np.exp(np.clip(said, *limits) / 2))


def usual_row(sightings: Sightings) -> Floats:
    """(f,) the row of each feature, robustly."""
    row = sightings.row
    usual = sightings.means(row, np.ones_like(row))
    for _ in range(3):
        off = (row - usual[sightings.feature]) / ROW_SIGMA_PX
        usual = sightings.means(row, 1 / (1 + off**2) ** 2)
    return usual


def _support(sightings: Sightings, theta: Floats) -> Floats:
    """(s,) other sightings of the same feature from nearby angles."""
    place = within_turn(theta)
    # The mean gap: where turns are repeated, the usual one may be none at all.
    reach = SUPPORT_STEPS * float(np.ptp(place)) / max(len(theta) - 1, 1)
    # Features lie further apart on this line than any two angles do.
    key = 20.0 * sightings.feature + place[sightings.projection]
    ordered = np.sort(key)
    after = np.searchsorted(ordered, key + reach, side="right")
    return np.asarray(after - np.searchsorted(ordered, key - reach) - 1, np.float64)
