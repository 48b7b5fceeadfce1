"""What the features say about the steps inside triplets of projections."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.refinement.factors.block import Block

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats


@method
class Cv:
    """The paper's CV-factors: both steps of a triplet, measured on its features.

    One factor holds both steps of a triplet, because their errors go together: a wrong scale of
    the arc makes both too long. The paper takes them for independent.
    """

    correlated: bool = True
    """Whether the covariance of both steps is used, or, as in the paper, their variances alone."""
    floor_deg: Annotated[float, Field(ge=0)] = 0.1
    """Standard deviation added to each step, degrees: errors that all tracks share."""
    robust: Annotated[float, Field(gt=0)] = 3.0
    """Standard deviations beyond which a triplet loses its grip."""

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:  # noqa: ARG002
        """Return a factor for each measured triplet, see `Factor`."""
        variances = measurements.covariance * np.eye(2)
        covariance = measurements.covariance if self.correlated else variances
        covariance = covariance + np.deg2rad(self.floor_deg) ** 2 * np.eye(2)
        # The inverse of the lower Cholesky factor whitens.
        return Block(
            projections=measurements.projections,
            jacobian=np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]]),
            measured=measurements.steps,
            whitening=np.linalg.inv(np.linalg.cholesky(covariance)),
            robust=self.robust,
        )
