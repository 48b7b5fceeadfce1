"""What the rows of sightings say about the roll: on an axis that leans, ``v = Y - roll u``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.images import robust_scale
from tomoslam_stage.refinement.weighing import geman_mcclure

if TYPE_CHECKING:
    from tomoslam_stage.products import Geometry, Quadratic
    from tomoslam_stage.refinement.sightings import Sightings
    from tomoslam_stage.refinement.weighing import Strictness


def hear_rows(
    columns: Quadratic,
    sightings: Sightings,
    geometry: Geometry,
    strictness: Strictness,
    inflation: float = 1.0,
) -> None:
    """Add what the rows of sightings say to what their `columns` say, in place.

    The row Y of each feature on the axis is eliminated. Columns hardly tell a roll from places and
    angles that suit it; rows do, and hold it. `inflation` is that of the variances.
    """
    u = sightings.column - geometry.origin(sightings.row, sightings.projection)
    everyone = np.ones(len(u))
    u = u - sightings.means(u, everyone)[sightings.feature]
    level = geometry.level(sightings.column, sightings.row, sightings.projection)
    off = level - sightings.means(level, everyone)[sightings.feature]
    sigma = max(robust_scale(off), strictness.floor)
    weights = geman_mcclure(off, sigma, strictness.grip) / inflation
    roll = geometry.layout.roll
    columns.information[roll, roll] += np.sum(weights * u**2)
    columns.pull[roll] -= np.sum(weights * u * off)
