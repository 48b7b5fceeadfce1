"""A foam: edges of bubbles in front of edges of bubbles, and hardly a point to hold on to."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.simulation.bodies import Ellipsoid, Solids
from tomoslam_stage.simulation.placing import (
    FIELD_HALF_HEIGHT,
    column,
    packed_spheres,
    upright,
)

MATRIX = 0.009
"""Attenuation of the matrix per px in a field of radius 150."""


@method
class Foam:
    """Round bubbles that do not overlap in a column of matrix.

    Low in contrast and crowded; take it to see whether thresholds adapt to the scan.
    """

    seed: int = 1
    bubbles: Annotated[int, Field(ge=1)] = 900
    """Number of bubbles; those that find no place are left out."""
    smallest: Annotated[float, Field(gt=0)] = 4.0
    """px in a field of radius 150: the smallest radius of a bubble."""
    largest: Annotated[float, Field(gt=0)] = 24.0
    """px in a field of radius 150: the largest."""
    radius: Annotated[float, Field(gt=0, le=149)] = 130.0
    """px in a field of radius 150: the column of matrix."""

    def solids(self) -> tuple[Solids, ...]:
        """Matrix and bubbles; a bubble is minus the matrix."""
        rng = np.random.default_rng(self.seed)
        # Small bubbles are the many: the number falls with the square of the radius.
        share = rng.random(self.bubbles)
        sizes = 1 / (1 / self.smallest - share * (1 / self.smallest - 1 / self.largest))
        within = (self.radius - 1, FIELD_HALF_HEIGHT - 1)
        centres, radii = packed_spheres(sizes, within, rng)
        half = np.repeat(radii[:, None], 3, axis=1)
        density = np.full(len(radii), -MATRIX)
        bubbles = Solids(Ellipsoid(), centres, upright(len(radii)), half, density)
        return column(self.radius, FIELD_HALF_HEIGHT, MATRIX), bubbles
