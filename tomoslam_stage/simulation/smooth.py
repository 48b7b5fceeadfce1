"""A smooth object: there is nothing to track, and a sound method says so."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.simulation.bodies import Blob, Solids
from tomoslam_stage.simulation.placing import random_axes


@method
class Smooth:
    """A few wide Gaussian blobs. No angle can be measured on them from features.

    Take it to see that recorded angles are kept where nothing speaks for better ones.
    """

    seed: int = 1
    blobs: Annotated[int, Field(ge=1)] = 6
    """Number of blobs."""

    def solids(self) -> tuple[Solids, ...]:
        """Blobs whose four standard deviations lie inside the field."""
        rng = np.random.default_rng(self.seed)
        centres = rng.uniform([-30, -20, -30], [30, 20, 30], (self.blobs, 3))
        half = rng.uniform(17, 24, (self.blobs, 3))
        density = rng.uniform(0.004, 0.01, self.blobs)
        return (Solids(Blob(), centres, random_axes(self.blobs, rng), half, density),)
