"""Where all projections look from, and what a source says about changes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products.arrays import Floats, Integers

Unknown: TypeAlias = Literal["theta", "axis", "roll", "shift"]
UNKNOWNS: tuple[Unknown, ...] = get_args(Unknown)
"""All that may be unknown about a geometry, in the order of a change of it."""
STILL: tuple[Unknown, ...] = ("theta", "axis", "roll")
"""What is unknown where the sample stands still on the stage."""


@dataclass(frozen=True)
class Layout:
    """Which of the k entries of a change of a `Geometry` are what.

    The angles come first, radians; then the axis, px, and the roll, radians; last the shifts, px,
    where they are unknown. An axis or roll that is held has its place all the same.
    """

    n: int
    """Number of projections."""
    unknowns: tuple[Unknown, ...] = STILL
    """What may change."""

    @property
    def size(self) -> int:
        """The number of entries, k."""
        return self.n + 2 + (self.n if "shift" in self.unknowns else 0)

    @property
    def angles(self) -> slice:
        """Those of the angles."""
        return slice(0, self.n)

    @property
    def axis(self) -> int:
        """That of the axis."""
        return self.n

    @property
    def roll(self) -> int:
        """That of the roll."""
        return self.n + 1

    @property
    def line(self) -> slice:
        """Those of axis and roll."""
        return slice(self.n, self.n + 2)

    @property
    def shifts(self) -> slice:
        """Those of the shifts; none where these are known."""
        return slice(self.n + 2, self.size)

    @property
    def own(self) -> tuple[slice, ...]:
        """Those that each projection has for itself, by kind."""
        return (self.angles, self.shifts) if "shift" in self.unknowns else (self.angles,)

    def free(self, entries: slice) -> Integers:
        """Numbers of those among `entries` that may change."""
        held = {self.axis: "axis", self.roll: "roll"}
        every = range(*entries.indices(self.size))
        kept = [k for k in every if held.get(k, "theta") in self.unknowns]
        return np.array(kept, np.intp)


@dataclass(frozen=True)
class Geometry:
    """Where all projections look from, and what of it is unknown.

    At a row the axis lies at ``axis + roll (row - middle)``; a projection is shifted as a whole.
    """

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column of the rotation axis at `middle`, px."""
    roll: float = 0.0
    """Tilt of the axis in the detector plane, radians."""
    middle: float = 0.0
    """Detector row where the axis lies at `axis`, px."""
    shift: Floats = field(default_factory=lambda: np.empty(0))
    """(n,) px that each projection lies to the right; by default none."""
    unknowns: tuple[Unknown, ...] = STILL
    """What may change."""

    def __post_init__(self) -> None:
        if self.shift.size == 0:
            object.__setattr__(self, "shift", np.zeros(len(self.theta)))

    @property
    def layout(self) -> Layout:
        """Which entries of a change are what."""
        return Layout(len(self.theta), self.unknowns)

    def moved(self, change: Floats) -> Geometry:
        """Return the geometry after a `change` (k,)."""
        parts = self.layout
        return replace(
            self,
            theta=self.theta + change[parts.angles],
            axis=self.axis + float(change[parts.axis]),
            roll=self.roll + float(change[parts.roll]),
            shift=self.shift + change[parts.shifts] if "shift" in self.unknowns else self.shift,
        )

    def since(self, start: Geometry) -> Floats:
        """(k,) the change that led here from `start`."""
        change = np.zeros(self.layout.size)
        change[self.layout.angles] = self.theta - start.theta
        change[self.layout.line] = self.axis - start.axis, self.roll - start.roll
        if "shift" in self.unknowns:
            change[self.layout.shifts] = self.shift - start.shift
        return change

    def axis_at(self, rows: NDArray[Any]) -> Floats:
        """Detector column of the axis at `rows`, px, where no projection is shifted."""
        return np.asarray(self.axis + self.roll * (rows - self.middle), np.float64)

    def origin(self, rows: NDArray[Any], projections: NDArray[Any] | int) -> Floats:
        """Detector column where points on the axis appear at `rows` in `projections`, px."""
        return np.asarray(self.axis_at(rows) + self.shift[projections])

    def level(self, columns: Floats, rows: Floats, projections: NDArray[Any]) -> Floats:
        """Rows as they would be if the axis did not lean, px: ``v = Y - roll u``."""
        return np.asarray(rows + self.roll * (columns - self.axis - self.shift[projections]))


@dataclass(frozen=True)
class Quadratic:
    """What one source says about a change of the geometry, near where it looked.

    Up to a constant, the log likelihood of a change d (k,), see `Layout`, is
    ``pull . d - d . information . d / 2``.
    """

    information: Floats
    """(k, k) positive semidefinite."""
    pull: Floats
    """(k,) slope at no change."""

    def after(self, change: Floats) -> Quadratic:
        """Return the same, told from where a `change` (k,) leads to."""
        return Quadratic(self.information, self.pull - self.information @ change)


Solve: TypeAlias = Callable[[Geometry, Quadratic], Floats]
"""(k,) the change that everything known together wants, given what one source says."""
