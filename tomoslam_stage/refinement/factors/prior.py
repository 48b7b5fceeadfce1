"""The first angle is held where it was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.refinement.factors.block import Block

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats


@method
class Prior:
    """``p(theta_0)`` of the paper's equation 4: nothing in the scan tells the absolute angle."""

    sigma_deg: Annotated[float, Field(gt=0)] = 1e-3
    """Standard deviation of the first angle, degrees."""

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:  # noqa: ARG002
        """One factor on the first projection, see `Factor`."""
        whitening = np.full((1, 1, 1), 1 / np.deg2rad(self.sigma_deg))
        return Block(np.zeros((1, 1), np.intp), np.ones((1, 1)), theta[:1, None], whitening)
