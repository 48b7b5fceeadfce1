"""Steps to where the map and all else agree, the curvature learning on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tomoslam_stage.mapping.curvature import Place, learn
from tomoslam_stage.mapping.looking import Look
from tomoslam_stage.mapping.weighing import (
    doubts,
    formal_sigma,
    noise,
    variances,
    whitened,
)
from tomoslam_stage.products import Floats, Geometry, Layout, Quadratic, Solve

LONGEST = np.deg2rad(1.0)
"""Radians that an angle may change in one step."""
NEGLIGIBLE = np.deg2rad(0.005)
"""Radians: a step this short is taken whatever it does to the residual."""
NEGLIGIBLE_PX = 0.02
"""Px: the same of the shift of a projection."""
RISE = 1.002
"""How far the residual may rise in a step, as a factor."""
UNWEIGHED = 3
"""First steps in which all projections weigh the same: misfit is mostly wrong angles then."""
SETTLED = 1 / 3
"""Change, in formal sigmas, that ends the steps."""


@dataclass(frozen=True)
class Weighed:
    """What a place says, in standard deviations."""

    quadratic: Quadratic
    """Information and pull."""
    pulls: Floats
    """(m, k) that were asked for, too."""
    variance: Floats
    """(k,) of the pull, in units of the curvature, squared line integrals."""
    weights: Floats
    """(n,) of the projections' residuals, one where they fit best."""


def weighed(place: Place, misfit: float | None, pulls: Floats | None = None) -> Weighed:
    """Weigh rows by their scatter and, unless `misfit` is None, projections by their misfit.

    So are `pulls` (m, k), if there are any.
    """
    layout, look = place.geometry.layout, place.look
    if misfit is None:
        each = np.average(
            noise(look, place.curvature), weights=np.diag(place.curvature)[: layout.n]
        )
        variance, weights = np.full(layout.size, each), np.ones(layout.n)
    else:
        variance = variances(look, place.geometry, place.curvature, misfit)
        weights = 1 / doubts(look, place.geometry.theta, misfit)
    asked = look.pull[None] if pulls is None else np.vstack([look.pull, pulls])
    information, told = whitened(place.curvature, variance, asked)
    return Weighed(Quadratic(information, told[0]), told[1:], variance, weights / weights.max())


@dataclass(frozen=True)
class Stepping:
    """How steps are made, from which looks, and which projections are trusted."""

    look: Callable[[Geometry], Look]
    """What the rows say at a geometry."""
    solve: Solve
    """Which change is wanted."""
    misfit: float
    """Excess residual, in medians, at which the noise of a projection counts double."""

    def run(self, place: Place, steps: int) -> Place | None:
        """Go at most `steps` steps from `place`, seen by other rows; None for what's no number.

        Its curvature is worked on in place: `place` is used up.
        """
        place = self._seen(place)
        for step in range(steps):
            further = self._further(place, step)
            if further is None or further is place:
                return further
            place = further
        return place

    def _further(self, place: Place, step: int) -> Place | None:
        """Go the step of this number from `place`; stay there where it would be none."""
        now = weighed(place, self.misfit if step >= UNWEIGHED else None)
        change = self.solve(place.geometry, now.quadratic)
        if not np.isfinite(change).all():
            return None
        if step >= UNWEIGHED and settled(change, now.quadratic, place.geometry.layout):
            return place
        return self._moved(place, limited(change, place.geometry.layout), now.weights)

    def _seen(self, place: Place) -> Place:
        """Return the same place as these rows see it, the curvature in proportion."""
        look = self.look(place.geometry)
        angles = place.geometry.layout.angles
        more = look.conditional[angles].sum() / place.look.conditional[angles].sum()
        np.multiply(place.curvature, more, out=place.curvature)
        return replace(place, look=look)

    def _moved(self, place: Place, change: Floats, weights: Floats) -> Place:
        """Go by `change`, or less of it where the residual would rise."""
        residual = (place.look.squares * weights).mean()
        while True:
            geometry = place.geometry.moved(change)
            look = self.look(geometry)
            if (
                negligible(change, geometry.layout)
                or (look.squares * weights).mean() < RISE * residual
            ):
                break
            change = change / 3
        answer = place.look.pull - look.pull
        learn(place.curvature, change, answer, look.conditional)
        return Place(geometry, look, place.curvature)


def negligible(change: Floats, layout: Layout) -> bool:
    """Whether no angle moves by `NEGLIGIBLE`, and no projection by `NEGLIGIBLE_PX`."""
    shifts = np.abs(change[layout.shifts]).max(initial=0)
    return bool(np.abs(change[layout.angles]).max() < NEGLIGIBLE and shifts < NEGLIGIBLE_PX)


def limited(change: Floats, layout: Layout) -> Floats:
    """`change`, shortened so that no angle moves by more than `LONGEST`."""
    longest = np.abs(change[layout.angles]).max()
    return change if longest <= LONGEST else change * (LONGEST / longest)


def settled(change: Floats, quadratic: Quadratic, layout: Layout) -> bool:
    """Whether the angles change, but for their mean, by far less than they are unsure."""
    sigma = formal_sigma(quadratic.information, layout)
    return bool(np.std(change[layout.angles]) < SETTLED * sigma)
