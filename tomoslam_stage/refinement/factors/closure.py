"""Half a turn on, and a full turn on, the same is seen again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.refinement.factors.block import Block

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats


@method
class Closure:
    """Each closure puts a projection between two others, half turns before."""

    robust: Annotated[float, Field(gt=0)] = 3.0
    """Standard deviations beyond which a closure loses its grip."""

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:  # noqa: ARG002
        """Return a factor for each closure, see `Factor`."""
        closures = measurements.closures
        share = closures.share[:, None, None]
        return Block(
            projections=closures.projections,
            jacobian=np.concatenate([np.ones_like(share), share - 1, -share], axis=2),
            measured=closures.turn[:, None],
            whitening=1 / closures.sigma[:, None, None],
            robust=self.robust,
        )
