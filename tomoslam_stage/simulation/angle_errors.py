"""How the stage betrays the encoder: recorded angles are nominal, true ones are disturbed.

To add one: a method with `disturb`, and a line in `ANGLE_ERRORS`. A recipe may name several; they
add up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.products import Floats


@runtime_checkable
class AngleError(Protocol):
    """One way in which true angles differ from nominal ones."""

    def disturb(self, theta: Floats, rng: np.random.Generator) -> Floats:
        """(n,) radians: true angles of projections taken, in this order, at nominal `theta`."""
        ...


@method
class EncoderWalk:
    """Every step is a little wrong, and the errors add up; the first angle is exact."""

    sigma_deg: Annotated[float, Field(ge=0)] = 0.05
    """Standard deviation of each step."""

    def disturb(self, theta: Floats, rng: np.random.Generator) -> Floats:
        """(n,) radians: true angles."""
        steps = rng.normal(0, np.deg2rad(self.sigma_deg), len(theta) - 1)
        return np.concatenate([theta[:1], theta[1:] + np.cumsum(steps)])


@method
class Jitter:
    """Every angle is a little wrong, independently of all others."""

    sigma_deg: Annotated[float, Field(ge=0)] = 0.1
    """Standard deviation of each angle."""

    def disturb(self, theta: Floats, rng: np.random.Generator) -> Floats:
        """(n,) radians: true angles."""
        return theta + rng.normal(0, np.deg2rad(self.sigma_deg), len(theta))


@method
class LostStep:
    """The motor loses steps once: from that projection on the stage lags behind."""

    size_deg: float = 1.5
    """How far it lags."""
    projection: Annotated[int, Field(ge=1)] | None = None
    """The first projection that lags; drawn from the middle half of the scan if not given."""

    def disturb(self, theta: Floats, rng: np.random.Generator) -> Floats:
        """(n,) radians: true angles."""
        n = len(theta)
        first = self.projection or int(rng.integers(n // 4, 3 * n // 4))
        return np.where(np.arange(n) < first, theta, theta - np.deg2rad(self.size_deg))


@method
class Eccentric:
    """The encoder's disc is off centre: an error of one period a turn."""

    amplitude_deg: Annotated[float, Field(ge=0)] = 0.3
    """Largest error."""
    phase_deg: float = 0.0
    """The error is ``amplitude sin(theta + phase)``."""

    def disturb(self, theta: Floats, rng: np.random.Generator) -> Floats:  # noqa: ARG002
        """(n,) radians: true angles."""
        error_deg = self.amplitude_deg * np.sin(theta + np.deg2rad(self.phase_deg))
        return np.asarray(theta + np.deg2rad(error_deg))


ANGLE_ERRORS: Mapping[str, type[AngleError]] = {
    "walk": EncoderWalk,
    "jitter": Jitter,
    "lost_step": LostStep,
    "eccentric": Eccentric,
}
