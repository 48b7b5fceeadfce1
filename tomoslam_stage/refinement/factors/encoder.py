"""What the rotation stage says about its own steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.products import StageNoise
from tomoslam_stage.refinement.factors.block import Block

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats

START_DEG = 0.05
"""Standard deviation of a step, degrees, before anything is known about the stage."""


@method
class Encoder:
    """The paper's Enc-factors: each recorded step is right but for noise.

    Errors of steps add up along the scan (a walk); errors of single angles (jitter) do not. A lost
    step is far outside the noise; the robust noise model lets go of it, so that it does not smear
    over its neighbours.
    """

    sigma_deg: Annotated[float, Field(gt=0)] | None = None
    """Standard deviation of the error of a recorded step, degrees; by default estimated from the
    scan, from the paper's 0.05 degrees on."""
    jitter_deg: Annotated[float, Field(ge=0)] | None = None
    """Standard deviation of the error of a single recorded angle, degrees; by default estimated
    from the scan, from none on."""
    robust: Annotated[float, Field(gt=0)] = 4.0
    """Standard deviations beyond which a step loses its grip."""

    @property
    def noise(self) -> StageNoise:
        """Its noise, in radians."""
        walk = START_DEG if self.sigma_deg is None else self.sigma_deg
        return StageNoise(float(np.deg2rad(walk)), float(np.deg2rad(self.jitter_deg or 0.0)))

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:
        """Return a factor for each pair of projections that follow each other, see `Factor`."""
        following = np.arange(len(theta) - 1)
        variances = self._variances(len(following), measurements)
        return Block(
            projections=np.stack([following, following + 1], axis=1),
            jacobian=np.array([[-1.0, 1.0]]),
            measured=np.diff(theta)[:, None],
            whitening=(1 / np.sqrt(variances))[:, None, None],
            robust=self.robust,
        )

    def chain(
        self, recorded: Floats, theta: Floats, measurements: AngleMeasurements
    ) -> tuple[Floats, Floats]:
        """Take all steps together: neighbours err against each other where angles jitter.

        Parameters
        ----------
        recorded, theta
            (n,) radians.
        measurements
            How many steps of the stage lie in between.

        Returns
        -------
        Covariance (2, n - 1), radians squared, of the steps and of each with the next, and by how
        much they want to change (n - 1,), radians. A step beyond `robust` has its variance raised,
        as Cauchy's would be. None within is: where angles jitter, hardly any of the variance of
        the steps adds up, and a few per cent more would let the angles drift.
        """
        errors = np.diff(theta - recorded)
        usual = self._variances(len(errors), measurements)
        raised = np.maximum(usual, errors**2 / self.robust**2)
        return np.stack([raised, np.full(len(raised), -(self.noise.jitter**2))]), -errors

    def _variances(self, count: int, measurements: AngleMeasurements) -> Floats:
        """(count,) radians squared: of the recorded differences of projections in a row."""
        return np.asarray(self.noise.variance_after(np.ones(count) * measurements.stage_steps))
