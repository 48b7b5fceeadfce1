"""How a sample betrays the stage: it moves while it is turned, which no angle can make good.

To add one: a method with `moved`, and a line in `SAMPLE_MOTIONS`. A recipe may name several; each
moves what the one before it left.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.simulation.bodies import Solids


@runtime_checkable
class SampleMotion(Protocol):
    """One way in which a sample moves on the stage, in the stage's own coordinates."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:
        """Return `group` as it is at `when`, from 0 at the first projection to 1 at the last.

        `rng` draws the same numbers for every group of one projection.
        """
        ...


@method
class Shaking:
    """Every projection finds the sample somewhere else: a loose mount, vibration.

    Along the rows of the detector, too, which no unknown takes up; jitter along the columns alone,
    with its truth in the file, is `Recipe.shift_px`.
    """

    sigma_px: Annotated[float, Field(ge=0)] = 2.0
    """Standard deviation along each of X, Y and Z."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:  # noqa: ARG002
        """Return `group` elsewhere."""
        return group.moved(np.eye(3), rng.normal(0, self.sigma_px, 3))


@method
class Drifting:
    """The sample creeps along: it is warmed, or its glue gives way."""

    x_px: float = 6.0
    """How far it has come along X at the end."""
    y_px: float = 2.0
    """Along Y, down the rows."""
    z_px: float = 0.0
    """Along Z."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:  # noqa: ARG002
        """Return `group` farther on."""
        return group.moved(np.eye(3), when * np.array([self.x_px, self.y_px, self.z_px]))


@method
class Leaning:
    """The sample topples slowly, about the X axis."""

    angle_deg: float = 4.0
    """How far it leans at the end."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:  # noqa: ARG002
        """Return `group` leaning."""
        cosine, sine = _unit(when * self.angle_deg)
        return group.moved(
            np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]), np.zeros(3)
        )


@method
class Slipping:
    """The upper half of the sample turns by itself on the lower one."""

    angle_deg: float = 8.0
    """How far it has turned at the end."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:  # noqa: ARG002
        """Return `group`, its parts above the middle turned about the axis."""
        cosine, sine = _unit(when * self.angle_deg)
        turned = group.moved(
            np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]), np.zeros(3)
        )
        above = group.centre[:, 1] < 0
        return Solids(
            group.body,
            np.where(above[:, None], turned.centre, group.centre),
            np.where(above[:, None, None], turned.axes, group.axes),
            group.half,
            group.density,
        )


@method
class Swelling:
    """The sample grows or, where it dries, shrinks; its mass stays."""

    share: Annotated[float, Field(gt=-1)] = -0.05
    """By how much it is larger at the end, as a share of its size."""

    def moved(self, group: Solids, when: float, rng: np.random.Generator) -> Solids:  # noqa: ARG002
        """Return `group` of another size."""
        return group.scaled(1 + when * self.share)


SAMPLE_MOTIONS: Mapping[str, type[SampleMotion]] = {
    "shaking": Shaking,
    "drifting": Drifting,
    "leaning": Leaning,
    "slipping": Slipping,
    "swelling": Swelling,
}


def _unit(angle_deg: float) -> tuple[float, float]:
    """Return cosine and sine."""
    angle = np.deg2rad(angle_deg)
    return float(np.cos(angle)), float(np.sin(angle))
