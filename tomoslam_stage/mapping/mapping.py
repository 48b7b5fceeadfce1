"""The angles that the reconstruction itself asks for."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import rms_difference, spread
from tomoslam_stage.mapping.curvature import Place, looks_needed, probed
from tomoslam_stage.mapping.looking import Observed, Reading, likeliest, observed, strongest
from tomoslam_stage.mapping.stepping import Stepping, weighed
from tomoslam_stage.mapping.weighing import misfits
from tomoslam_stage.methods import method
from tomoslam_stage.parallel import on_one_thread
from tomoslam_stage.products import Floats, Geometry, Integers, Quadratic
from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Pixels, Scan, Solve

FEWEST_ROWS = 4
"""Fewer do not show by their scatter how sure they are."""
FEWEST_PROJECTIONS = 20
"""Fewer make no map."""
WEAKEST = 0.01
"""Strength of the prior that none is compared with."""
FARTHEST = np.deg2rad(20)
"""Radians, rms: a map that goes farther from where it began has lost its way."""
DOUBTED_SPREAD = 0.2
"""Px^2: how far the point spread that hides edges may be off, as it acts on thick ones."""
USUAL = 0.02
"""Strength of the prior while the point spread is looked for."""


@dataclass(frozen=True)
class Mapped:
    """Where the map and all else ended, and what the map says there."""

    geometry: Geometry
    """That at the end."""
    quadratic: Quadratic
    """What the map says about changes of it."""
    row_pulls: Floats
    """(r, k) the share of each row in the pull."""
    excess: float
    """Largest residual of a projection, in units of the median: how far the model is violated."""
    squares: Floats
    """(r, n) mean squared residual of each row and projection, squared line integrals."""
    bias_pulls: Floats
    """(b, k) by how much the pull would change with half as strong a prior for the map; and, where
    hidden edges were given back, with somewhat more of them."""
    rows: Integers
    """(r,) rows of the scan that were used."""
    strength: float
    """Of the total variation, in standard deviations of the map."""


@method
class Mapping:
    """Reconstruct, project, and ask what change of the geometry the difference wants.

    A few rows and steps first, then more rows, for which the curvature is known by then. Works
    where features fail: fine texture everywhere, few edges. Not where projections break the
    linear model (thick plates, edge on): see `Mapped.excess`, and look closer.
    """

    cutoff: Annotated[float, Field(gt=0)] = 8.0
    """What is smoother along the columns than a Gaussian of this width, px, does not count."""
    binning: Annotated[int, Field(ge=1)] = 2
    """Columns made one before anything else: the noise of single ones biases the map."""
    rows_first: Annotated[int, Field(ge=FEWEST_ROWS)] = 12
    """Rows at first."""
    steps_first: Annotated[int, Field(ge=0)] = 5
    """Most steps with them."""
    rows: Annotated[int, Field(ge=FEWEST_ROWS)] = 32
    """Rows afterwards."""
    steps: Annotated[int, Field(ge=0)] = 12
    """Most steps with those."""
    probe_rows: Annotated[int, Field(ge=FEWEST_ROWS)] = 8
    """Rows that show how the pull answers to changes, and how strong the prior may be."""
    strengths: tuple[Annotated[float, Field(ge=0)], ...] = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15)
    """Of the total variation, in standard deviations of the map; left-out projections choose."""
    spreads: tuple[Annotated[float, Field(ge=0)], ...] = (0.0,)
    """Px^2: half the variance of a point spread that hides edges; left-out projections choose."""
    wide: Annotated[float, Field(ge=1)] = 1.5
    """Side of the map where the object reaches beyond the detector, in widths of it."""
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.04
    """Least information on any change, in units of what it were if the map were known."""
    misfit: Annotated[float, Field(gt=0)] = 0.5
    """Excess residual of a projection, in medians, that doubles the noise of what it says."""

    @classmethod
    def closer(cls) -> Mapping:
        """Return how to look where thick projections break the linear model.

        Single columns, as thin layers are seen edge on; what edges hide given back; no prior so
        strong that it flattens what is thin; and what fits badly all the same counts for less.
        """
        spreads = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
        strengths = (0.0, 0.01, 0.02, 0.03, 0.05)
        return cls(binning=1, spreads=spreads, strengths=strengths, misfit=0.25)

    def refine(self, scan: Scan, rows: Integers, start: Geometry, solve: Solve) -> Mapped | None:
        """Improve on `start`; None where the rows say nothing.

        Parameters
        ----------
        scan
            Line integrals.
        rows
            (r,) rows of the scan that may be used.
        start
            The geometry to begin with, px of `scan`, and what of it is unknown.
        solve
            Which change the map and all else together want, asked at each step.
        """
        if len(rows) < FEWEST_ROWS or scan.n_projections < FEWEST_PROJECTIONS:
            return None
        few, many = (self._observed(scan, rows, count) for count in (self.rows_first, self.rows))
        numbers = np.isfinite([*start.theta, *start.shift, start.axis, start.roll]).all()
        if not (numbers and usable(few.sinograms) and usable(many.sinograms)):
            return None
        with on_one_thread():
            try:
                return self._refined(few, many, start, solve)
            except np.linalg.LinAlgError:  # what so few projections say cannot be solved for
                return None

    def _refined(
        self, few: Observed, many: Observed, start: Geometry, solve: Solve
    ) -> Mapped | None:
        """Step with `few` rows, then with `many`."""
        expected = looks_needed(start.layout) + self.steps_first + self.steps + 4
        looks = progress(range(expected), "mapping", expected)
        few = self._fitted(few, start)
        place = probed(counted(few.part(self.probe_rows), looks), start, self.floor)
        if place is None:
            return None
        stepping = Stepping(counted(few, looks), solve, self.misfit)
        first = stepping.run(place, self.steps_first)
        if first is None:
            return None
        many = self._fitted(many, first.geometry)
        stepping = Stepping(counted(many, looks), solve, self.misfit)
        last = stepping.run(first, self.steps)
        if last is None or rms_difference(last.geometry.theta, start.theta) > FARTHEST:
            return None
        otherwise = [replace(many, strength=many.strength / 2 or WEAKEST)]
        if many.edges is not None:
            otherwise.append(many.unhidden(DOUBTED_SPREAD))
        ended = self._mapped(many, last, [counted(o, looks)(last.geometry) for o in otherwise])
        deque(looks, maxlen=0)
        return ended

    def _observed(self, scan: Scan, rows: Integers, count: int) -> Observed:
        """Read up to `count` of `rows`, evenly spread."""
        some = rows[spread(len(rows), count)]
        edges = len(self.spreads) > 1
        return observed(scan, some, rows, Reading(self.binning, self.cutoff, self.wide, edges))

    def _fitted(self, rows: Observed, geometry: Geometry) -> Observed:
        """`rows` as projections left out are predicted best: edges unhidden, prior for the map.

        Of the priors, the strongest that is as good as the best.
        """
        if len(self.spreads) > 1:
            part = replace(rows.part(self.probe_rows), strength=USUAL)
            rows = rows.unhidden(likeliest(part, geometry, self.spreads))
        part = rows.part(self.probe_rows)
        return replace(rows, strength=strongest(part, geometry, self.strengths))

    def _mapped(self, rows: Observed, place: Place, otherwise: list[Look]) -> Mapped | None:
        """Return what is known at the end, and what it would be had we assumed otherwise."""
        look, said = place.look, weighed(place, self.misfit)
        ended = Mapped(
            place.geometry,
            said.quadratic,
            look.pulls @ said.whitener.T,
            float(misfits(look.squares, place.geometry.theta).max()),
            look.squares,
            np.stack([said.whitener @ (other.pull - look.pull) for other in otherwise]),
            rows.rows,
            rows.strength,
        )
        numbers = (said.quadratic.information, ended.row_pulls, ended.bias_pulls)
        return ended if all(np.isfinite(some).all() for some in numbers) else None


def usable(sinograms: Pixels) -> bool:
    """Whether `sinograms` (r, n, column) are numbers, and not all alike."""
    return bool(np.isfinite(sinograms).all() and np.ptp(sinograms) > 0)


def counted(rows: Observed, looks: Iterator[int]) -> Callable[[Geometry], Look]:
    """Return `rows`' way to look, each of which takes one of `looks`."""

    def look(geometry: Geometry) -> Look:
        seen = rows.look(geometry)
        next(looks, None)
        return seen

    return look
