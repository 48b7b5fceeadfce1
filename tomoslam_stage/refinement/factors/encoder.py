"""What the rotation stage says about its own steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.refinement.factors.block import Block

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats


@method
class Encoder:
    """The paper's Enc-factors: each recorded step is right but for independent noise.

    Errors of the steps add up along the scan (a walk). A lost step is far outside the noise; the
    robust noise model lets go of it, so that it does not smear over its neighbours.
    """

    sigma_deg: Annotated[float, Field(gt=0)] = 0.05
    """Standard deviation of a recorded step, degrees (the paper's stepper motor)."""
    robust: Annotated[float, Field(gt=0)] = 4.0
    """Standard deviations beyond which a step loses its grip."""

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:  # noqa: ARG002
        """Return a factor for each pair of projections that follow each other, see `Factor`."""
        following = np.arange(len(theta) - 1)
        return Block(
            projections=np.stack([following, following + 1], axis=1),
            jacobian=np.array([[-1.0, 1.0]]),
            measured=np.diff(theta)[:, None],
            whitening=np.full((len(theta) - 1, 1, 1), 1 / np.deg2rad(self.sigma_deg)),
            robust=self.robust,
        )
