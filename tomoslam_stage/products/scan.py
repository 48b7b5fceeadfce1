"""A scan, and where its projections come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, TypeAlias

import numpy as np

from tomoslam_stage.products.arrays import Floats, Integers, Pixels

if TYPE_CHECKING:
    from pathlib import Path

Along: TypeAlias = Literal["projection", "row"]
"""What a block holds whole: some projections with all rows, or some rows of all projections."""
Values: TypeAlias = Literal["counts", "transmission", "line_integrals"]


class ProjectionSource(Protocol):
    """Where a scan's line integrals come from: a file, read lazily, or an array."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        ...

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Values (projection, row, column), float32, of the chosen projections and rows."""
        ...


class Conversion(Protocol):
    """Makes line integrals of what a detector stored."""

    kind: ClassVar[Values]
    """What it takes."""

    def __call__(self, raw: Pixels, projections: Integers, rows: Integers, /) -> Pixels:
        """Line integrals of `raw` (p, r, c), which may be changed in place."""
        ...


@dataclass(frozen=True)
class Raw:
    """What is needed to make line integrals of projections that are none yet."""

    conversion: Conversion
    """Makes them, where the pipeline does not."""
    flats: ProjectionSource | None = None
    """(f, row, column) the beam without the object, counts."""
    darks: ProjectionSource | None = None
    """(f, row, column) the detector without the beam, counts."""


@dataclass(frozen=True)
class Scan:
    """A scan as it was recorded; its projections are read when they are asked for."""

    source: ProjectionSource
    """Line integrals (but see `raw`), one projection per entry of `theta`."""
    theta: Floats
    """(n,) radians, unwrapped: the recorded angles."""
    frames: Integers
    """(n,) index of each projection in the file."""
    theta_of_frames: Floats | None = None
    """(m,) radians: the recorded angle of every frame in the file, NaN where it has none; None
    where all frames are projections."""
    left_out: Mapping[int, str] = field(default_factory=dict)
    """Frame of the file that is no projection of the scan -> why."""
    name: str = "scan"
    """What messages call it."""
    path: Path | None = None
    """The file, where there is one."""
    binning: int = 1
    """Detector pixels of the file in one pixel of `source`, along rows and columns."""
    raw: Raw | None = None
    """Where `source` still gives what the detector stored; None once these are line integrals."""

    def __post_init__(self) -> None:
        n = self.source.shape[0]
        if self.theta.shape != (n,) or self.frames.shape != (n,):
            raise ValueError(
                f"{n} projections need {n} angles and {n} frames; "
                f"found {self.theta.shape} and {self.frames.shape}"
            )

    @property
    def values(self) -> Values:
        """What `source` gives."""
        return "line_integrals" if self.raw is None else self.raw.conversion.kind

    @property
    def n_projections(self) -> int:
        """Number of projections."""
        return self.source.shape[0]

    @property
    def n_rows(self) -> int:
        """Number of detector rows."""
        return self.source.shape[1]

    @property
    def n_columns(self) -> int:
        """Number of detector columns."""
        return self.source.shape[2]

    @property
    def stage_steps(self) -> Floats:
        """(n - 1,) steps that the stage made from each projection to the next.

        More than one across frames that were left out; those without an angle, such as flats in
        between, take none.
        """
        if self.theta_of_frames is None:
            return np.ones(self.n_projections - 1)
        made = np.cumsum(np.isfinite(self.theta_of_frames))
        return np.diff(made[self.frames]).astype(np.float64)

    def projection(self, index: int) -> Pixels:
        """(row, column) line integrals of one projection."""
        alone: Pixels = self.source.read(np.array([index]), np.arange(self.n_rows))[0]
        return alone

    def column_in_file(self, column: float) -> float:
        """Return the detector column of the file, px, at the centre of `column` of this scan."""
        return column * self.binning + (self.binning - 1) / 2

    def column_from_file(self, column: float) -> float:
        """Return the column of this scan, px, that lies at detector `column` of the file."""
        return (column - (self.binning - 1) / 2) / self.binning

    def sinograms(self, rows: Integers) -> Pixels:
        """(row, projection, column) line integrals of a few rows."""
        everything = np.arange(self.n_projections)
        return self.source.read(everything, rows).transpose(1, 0, 2)
