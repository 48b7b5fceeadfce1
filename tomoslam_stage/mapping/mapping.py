"""The angles that the reconstruction itself asks for."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import rms_difference, spread
from tomoslam_stage.mapping.curvature import Place, looks_needed, probed
from tomoslam_stage.mapping.looking import USUAL, Observed, emptiest, strongest
from tomoslam_stage.mapping.placing import Made
from tomoslam_stage.mapping.reading import Reading, likeliest
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

Strengths: TypeAlias = Annotated[tuple[Annotated[float, Field(ge=0)], ...], Field(min_length=1)]
Shares: TypeAlias = Annotated[tuple[Annotated[float, Field(ge=0, lt=1)], ...], Field(min_length=1)]
FEWEST_ROWS = 4
"""Fewer do not show by their scatter how sure they are."""
FEWEST_PROJECTIONS = 20
"""Fewer make no map."""
WEAKEST = 0.01
"""Strength of the prior that none is compared with."""
FARTHEST = np.deg2rad(20)
"""Radians, rms: a map that goes farther from where it began has lost its way."""
DOUBTED_BLUR = 0.035
"""Px: how far the blur of intensities may be off: somewhat more than candidates a tenth of a pixel
apart leave it to chance (.029)."""


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
    """(b, k) by how much the pull would change with half as strong a prior for the map, or with
    another share of the densest place for air; and, where a blur was looked for, with somewhat more
    of it."""
    made: Made
    """How the map was made."""


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
    strengths: Strengths = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15)
    """Of the total variation, in standard deviations of the map; left-out projections choose."""
    blurs: tuple[Annotated[float, Field(ge=0)], ...] = (0.0,)
    """Px: standard deviation of the detector's blur, to be mended; left-out projections choose."""
    faintest: Shares = (0.0,)
    """Share of the densest place of a slice below which there is air, made empty; left-out
    projections choose. 0: nothing in the map is negative; total variation is for that alone."""
    wide: Annotated[float, Field(ge=1)] = 1.5
    """Side of the map where the object reaches beyond the detector, in widths of it."""
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.04
    """Least information on any change, in units of what it were if the map were known."""
    misfit: Annotated[float, Field(gt=0)] = 0.5
    """Excess residual of a projection, in medians, that doubles the noise of what it says."""

    @classmethod
    def closer(cls) -> Mapping:
        """Return how to look where thick projections break the linear model.

        Single columns, as thin layers are seen edge on, and more rows for that; where the air can
        be told from the object, no other prior, as that thickens what is thin; the blur of
        intensities mended; and what fits badly all the same counts for less.
        """
        return cls(
            binning=1,
            rows=64,
            blurs=(0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
            faintest=(0.0, 0.02, 0.05, 0.1),
            strengths=(0.0, 0.01, 0.02, 0.03, 0.05),
            misfit=0.25,
        )

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
        reading = Reading(scan, rows, self.binning, self.cutoff, self.wide)
        few, many = (
            reading.observed(rows[spread(len(rows), count)])
            for count in (self.rows_first, self.rows)
        )
        numbers = np.isfinite([*start.theta, *start.shift, start.axis, start.roll]).all()
        if not (numbers and usable(few.sinograms) and usable(many.sinograms)):
            return None
        with on_one_thread():
            try:
                return self._refined(reading, few, many, start, solve)
            except np.linalg.LinAlgError:  # what so few projections say cannot be solved for
                return None

    def _refined(
        self, reading: Reading, few: Observed, many: Observed, start: Geometry, solve: Solve
    ) -> Mapped | None:
        """Step with `few` rows, then with `many`."""
        expected = looks_needed(start.layout) + self.steps_first + self.steps + 4
        looks = progress(range(expected), "mapping", expected)
        few = self._fitted(reading, few, start)
        place = probed(counted(few.part(self.probe_rows), looks), start, self.floor)
        if place is None:
            return None
        stepping = Stepping(counted(few, looks), solve, self.misfit)
        first = stepping.run(place, self.steps_first)
        if first is None:
            return None
        many = self._fitted(reading, many, first.geometry)
        stepping = Stepping(counted(many, looks), solve, self.misfit)
        last = stepping.run(first, self.steps)
        if last is None or rms_difference(last.geometry.theta, start.theta) > FARTHEST:
            return None
        otherwise = [counted(o, looks)(last.geometry) for o in self._otherwise(reading, many)]
        ended = self._mapped(reading, many, last, otherwise)
        deque(looks, maxlen=0)
        return ended

    def _fitted(self, reading: Reading, rows: Observed, geometry: Geometry) -> Observed:
        """`rows` as projections left out are predicted best.

        First the share below which there is air, then the blur that is mended, then, where no air
        is told from the object, the strength of the prior: the largest that is as good as the best.
        """
        faintest = self.faintest[0]
        if len(self.faintest) > 1:
            faintest = emptiest(rows.part(self.probe_rows), geometry, self.faintest)
        # Thin layers blur like the detector; only where the air is empty can these be told apart.
        rows = replace(rows, faintest=faintest, strength=0.0 if faintest else USUAL)
        if len(self.blurs) > 1:
            blur = likeliest(reading, rows.part(self.probe_rows), geometry, self.blurs)
            rows = reading.mended(rows, blur)
        if faintest:
            return rows
        part = rows.part(self.probe_rows)
        return replace(rows, strength=strongest(part, geometry, self.strengths))

    def _otherwise(self, reading: Reading, rows: Observed) -> Iterator[Observed]:
        """`rows` as they would be had we assumed otherwise, by as much as may well be.

        The largest other share for air, or half the prior; and somewhat more blur.
        """
        if rows.faintest:
            others = [share for share in self.faintest if share not in {0, rows.faintest}]
            yield from (replace(rows, faintest=share) for share in others[-1:])
        else:
            yield replace(rows, strength=rows.strength / 2 or WEAKEST)
        if len(self.blurs) > 1:
            yield reading.mended(rows, rows.blur + DOUBTED_BLUR)

    def _mapped(
        self, reading: Reading, rows: Observed, place: Place, otherwise: list[Look]
    ) -> Mapped | None:
        """Return what is known at the end, and what it would be had we assumed otherwise."""
        look = place.look
        biases = [other.pull[None] - look.pull for other in otherwise]
        said = weighed(place, self.misfit, np.vstack([look.pulls, *biases]))
        ended = Mapped(
            place.geometry,
            said.quadratic,
            said.pulls[: len(rows.rows)],
            float(misfits(look, place.geometry.theta).max()),
            look.squares,
            said.pulls[len(rows.rows) :],
            Made(reading, rows, said.variance[place.geometry.layout.angles]),
        )
        numbers = (said.quadratic.information, ended.row_pulls, ended.bias_pulls)
        return ended if all(np.isfinite(some).all() for some in numbers) else None


def usable(sinograms: Pixels) -> bool:
    """Whether `sinograms` (r, n, column) are numbers, and not the same in all projections."""
    return bool(np.isfinite(sinograms).all() and np.ptp(sinograms, axis=1).any())


def counted(rows: Observed, looks: Iterator[int]) -> Callable[[Geometry], Look]:
    """Return `rows`' way to look, each of which takes one of `looks`."""

    def look(geometry: Geometry) -> Look:
        seen = rows.look(geometry)
        next(looks, None)
        return seen

    return look
