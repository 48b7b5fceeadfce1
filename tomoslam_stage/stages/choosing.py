"""Which sources of angle measurements to believe: by evidence, not by what they say themselves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.methods import method
from tomoslam_stage.products import Floats
from tomoslam_stage.refinement import Fused, agree, gain_sigma

RECORDED, FEATURES, MAP = "recorded", "features", "map"
USED = "used"
SIGNIFICANCE = 3.0
"""z score from which on a residual on unused rows is lower."""


@method
class Choice:
    """Weighs features against the map, by data that neither used and by how well the map holds."""

    most_excess: Annotated[float, Field(gt=1)] = 2.2
    """Residual of the worst projection, in units of the usual one, up to which the map holds: thick
    projections that its linear model cannot explain pull good angles away, and rows that were not
    used do not show it."""
    suspect_excess: Annotated[float, Field(gt=1)] = 1.5
    """The same from which on the map is looked at more closely before that is said."""
    hopeless_excess: Annotated[float, Field(gt=1)] = 4.0
    """The same from which on nothing is believed: what breaks the map, a sample that moves or a
    beam that is not parallel, misleads the features, too."""
    agreement: Annotated[float, Field(gt=0)] = 3.0
    """Standard deviations that both may be apart and still be used together."""

    def of(
        self,
        found: Mapping[str, Fused],
        excess: float,
        squares: Mapping[str, Floats],
        theta: Floats,
    ) -> dict[str, str]:
        """By name of each source found: ``used``, or why it is left out.

        Parameters
        ----------
        found
            The angles by each source alone.
        excess
            Residual of the worst projection in the map's account, in units of the usual one.
        squares
            ``recorded`` and the name of each source: (r, n) mean squared residual on unused rows.
        theta
            (n,) radians, recorded.
        """
        if excess > self.hopeless_excess:
            moves = "too badly for a sample that stands still in a parallel beam"
            why = f"left out: some projections fit {excess:.0f} times worse than usual, {moves}"
            return dict.fromkeys(found, why)
        if MAP in found and excess > self.most_excess and avoidable(found, squares, theta):
            why = f"left out: some projections fit {excess:.1f} times worse than usual"
            return {name: why if name == MAP else USED for name in found}
        if len(found) < 2:
            return dict.fromkeys(found, USED)
        if agree(found[FEATURES], found[MAP], self.agreement):
            return {FEATURES: USED, MAP: USED}
        apart = rms_difference(found[FEATURES].geometry.theta, found[MAP].geometry.theta)
        degrees = float(np.rad2deg(apart))
        why = f"left out: {degrees:.2g} degrees apart, and unused rows speak for the other"
        lower = FEATURES if falls(squares, FEATURES, MAP, theta) else MAP
        return {name: USED if name == lower else why for name in found}


def avoidable(found: Mapping[str, Fused], squares: Mapping[str, Floats], theta: Floats) -> bool:
    """Whether one can do without a map that does not hold: features are better than nothing.

    Where shifts are unknown it is worse than nothing: they take up what the map cannot explain, and
    unused rows reproject better with whatever angles go with them.
    """
    if "shift" in found[MAP].geometry.unknowns:
        return True
    return FEATURES in found and falls(squares, FEATURES, RECORDED, theta)


def falls(squares: Mapping[str, Floats], name: str, other: str, theta: Floats) -> bool:
    """Say whether unused rows reproject better with the angles of `name` than with the `other`."""
    pair = {"recorded": squares[other], "refined": squares[name]}
    return gain_sigma(pair, theta) >= SIGNIFICANCE
