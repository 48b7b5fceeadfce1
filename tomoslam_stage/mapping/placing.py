"""Projections placed in a map that others made, and that no longer changes.

The map does not follow them, so that each tells its own angle, whatever the others do: there is no
matrix that ties all to all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.mapping.curvature import conditional_curvature
from tomoslam_stage.products import Quadratic

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.mapping.looking import Look, Observed, Standing
    from tomoslam_stage.mapping.reading import Reading
    from tomoslam_stage.products import Floats, Geometry, Scan


@dataclass(frozen=True)
class Made:
    """How a map was made, and what it is worth."""

    reading: Reading
    """How rows were read."""
    observed: Observed
    """The rows it was made from."""
    variances: Floats
    """(n,) of what each projection says, in units of the curvature, squared line integrals."""

    def at(self, geometry: Geometry) -> Placing:
        """Return the map of `geometry`, for other projections to be placed in."""
        return Placing(self.reading, self.observed, self.observed.standing(geometry))


class Told(NamedTuple):
    """What projections say about their own places in a map."""

    quadratic: Quadratic
    """Information and pull."""
    halves: Floats
    """(k,) pull of every other row less that of the others."""


@dataclass(frozen=True)
class Placing:
    """Compares projections with a map that they have no part in."""

    reading: Reading
    """How rows are read."""
    observed: Observed
    """The rows, and how they were made comparable."""
    standing: Standing
    """The map."""

    def looking(self, scan: Scan) -> Callable[[Geometry], Look]:
        """Read the projections of `scan`; return what tells how they differ from the map."""
        rows, blur = self.observed.rows, self.observed.blur
        read = replace(self.reading, scan=scan).observed(rows, blur)
        return partial(replace(read, extent=self.observed.extent).look, standing_map=self.standing)

    @staticmethod
    def told(look: Look, geometry: Geometry, variances: Floats) -> Told:
        """Return what projections say, whose pull has `variances` (n,), see `Made`."""
        layout, weights = geometry.layout, np.zeros(geometry.layout.size)
        for entries in layout.own:
            weights[entries] = 1 / variances
        apart = look.pulls[::2].sum(axis=0) - look.pulls[1::2].sum(axis=0)
        # Angle and shift of a projection weigh the same, so that blocks stay symmetric.
        information = weights[:, None] * conditional_curvature(look, layout).toarray()
        return Told(Quadratic(information, weights * look.pull), weights * apart)
