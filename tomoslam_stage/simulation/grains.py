"""A container full of grains: texture everywhere, in every direction."""

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
    random_axes,
)


@method
class Grains:
    """Ellipsoids of many sizes, orientations and densities in a light matrix in a tube.

    The phantom with the most features; take it where a method should work if it works at all.
    """

    seed: int = 1
    grains: Annotated[int, Field(ge=1)] = 600
    """Number of grains; those that find no place are left out."""
    smallest: Annotated[float, Field(gt=0)] = 3.0
    """px in a field of radius 150: the smallest longest half axis of a grain."""
    largest: Annotated[float, Field(gt=0)] = 11.0
    """px in a field of radius 150: the largest."""
    radius: Annotated[float, Field(gt=0, le=145)] = 125.0
    """px in a field of radius 150: the inside of the tube."""

    def solids(self) -> tuple[Solids, ...]:
        """Tube, matrix and grains."""
        rng = np.random.default_rng(self.seed)
        sizes = self.smallest * (self.largest / self.smallest) ** rng.random(self.grains)
        height = FIELD_HALF_HEIGHT
        centres, longest = packed_spheres(sizes, (self.radius, height), rng)
        n = len(centres)
        half = longest[:, None] * np.stack(
            [np.ones(n), rng.uniform(0.6, 1, n), rng.uniform(0.45, 0.9, n)], axis=1
        )
        density = rng.choice([0.012, 0.02, 0.035], n, p=[0.5, 0.35, 0.15])
        density *= rng.uniform(0.8, 1.2, n)
        grains = Solids(Ellipsoid(), centres, random_axes(n, rng), half, density)
        tube = column(self.radius + 4, height, 0.006)
        return tube, column(self.radius, height, 0.002 - 0.006), grains
