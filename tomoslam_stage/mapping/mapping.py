"""The angles that the reconstruction itself asks for."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field
from threadpoolctl import threadpool_limits

from tomoslam_stage.mapping.curvature import Place, looks_needed, probed
from tomoslam_stage.mapping.looking import Observed, observed, spread, strongest
from tomoslam_stage.mapping.stepping import Stepping, weighed
from tomoslam_stage.mapping.weighing import misfits
from tomoslam_stage.methods import method
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


@dataclass(frozen=True)
class Mapped:
    """Where the map and all else ended, and what the map says there."""

    geometry: Geometry
    """Angles, axis and roll at the end."""
    quadratic: Quadratic
    """What the map says about them there."""
    row_pulls: Floats
    """(r, n + 2) the share of each row in the pull."""
    excess: float
    """Largest residual of a projection, in units of the median: how far the model is violated."""
    squares: Floats
    """(r, n) mean squared residual of each row and projection, squared line integrals."""
    prior_pull: Floats
    """(n + 2,) by how much the pull would change with half as strong a prior for the map."""
    rows: Integers
    """(r,) rows of the scan that were used."""
    strength: float
    """Of the total variation, in standard deviations of the map."""


@method
class Mapping:
    """Reconstruct, project, and ask what change of angles, axis and roll the difference wants.

    A few rows and steps first, then more rows, for which the curvature is known by then. Works
    where features fail: fine texture everywhere, few edges. Not where projections break the
    linear model (thick plates, edge on): see `Mapped.excess`.
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
    wide: Annotated[float, Field(ge=1)] = 1.5
    """Side of the map where the object reaches beyond the detector, in widths of it."""
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.04
    """Least information on any change, in units of what it were if the map were known."""
    misfit: Annotated[float, Field(gt=0)] = 0.5
    """Excess residual of a projection, in medians, that doubles the noise of what it says."""

    def refine(self, scan: Scan, rows: Integers, start: Geometry, solve: Solve) -> Mapped | None:
        """Improve on `start`; None where the rows say nothing.

        Parameters
        ----------
        scan
            Line integrals.
        rows
            (r,) rows of the scan that may be used.
        start
            Angles, axis (px of `scan`) and roll to begin with.
        solve
            Which change the map and all else together want, asked at each step.
        """
        if len(rows) < FEWEST_ROWS or scan.n_projections < FEWEST_PROJECTIONS:
            return None
        few, many = (self._observed(scan, rows, count) for count in (self.rows_first, self.rows))
        numbers = np.isfinite([*start.theta, start.axis, start.roll]).all()
        if not (numbers and usable(few.sinograms) and usable(many.sinograms)):
            return None
        # Linear algebra on several threads rounds as their number goes.
        with threadpool_limits(1):
            return self._refined(few, many, start, solve)

    def _refined(
        self, few: Observed, many: Observed, start: Geometry, solve: Solve
    ) -> Mapped | None:
        """Step with `few` rows, then with `many`."""
        expected = looks_needed(len(start.theta)) + self.steps_first + self.steps + 3
        looks = progress(range(expected), "mapping", expected)
        few = self._with_prior(few, start)
        place = probed(counted(few.part(self.probe_rows), looks), start, self.floor)
        if place is None:
            return None
        stepping = Stepping(counted(few, looks), solve, self.misfit)
        first = stepping.run(place, self.steps_first)
        if first is None:
            return None
        many = self._with_prior(many, first.geometry)
        stepping = Stepping(counted(many, looks), solve, self.misfit)
        last = stepping.run(first, self.steps)
        if last is None:
            return None
        weaker = replace(many, strength=many.strength / 2 or WEAKEST)
        ended = self._mapped(many, last, counted(weaker, looks)(last.geometry))
        deque(looks, maxlen=0)
        return ended

    def _observed(self, scan: Scan, rows: Integers, count: int) -> Observed:
        """Read up to `count` of `rows`, evenly spread."""
        some = rows[spread(len(rows), count)]
        return observed(scan, some, self.binning, self.cutoff, self.wide)

    def _with_prior(self, rows: Observed, geometry: Geometry) -> Observed:
        """`rows` with the strongest prior for the map that predicts projections left out."""
        part = rows.part(self.probe_rows)
        return replace(rows, strength=strongest(part, geometry, self.strengths))

    def _mapped(self, rows: Observed, place: Place, weaker: Look) -> Mapped | None:
        """Return what is known at the end, `weaker` being the look with a weaker prior."""
        look, said = place.look, weighed(place, self.misfit)
        ended = Mapped(
            place.geometry,
            said.quadratic,
            look.pulls @ said.whitener.T,
            float(misfits(look.squares, place.geometry.theta).max()),
            look.squares,
            said.whitener @ (weaker.pull - look.pull),
            rows.rows,
            rows.strength,
        )
        numbers = (said.quadratic.information, ended.row_pulls, ended.prior_pull)
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
