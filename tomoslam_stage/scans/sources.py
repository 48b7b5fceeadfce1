"""Where line integrals come from: a file, read lazily, or an array; binned where asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.products import Scan
from tomoslam_stage.scans.correction import LineIntegrals
from tomoslam_stage.scans.dxchange import DATA, open_file
from tomoslam_stage.scans.selection import BLOCK_PIXELS, gather

if TYPE_CHECKING:
    from pathlib import Path

    from tomoslam_stage.products import Floats, Integers, Pixels, ProjectionSource
    from tomoslam_stage.scans.kind import Conversion


@dataclass(frozen=True)
class FileSource:
    """Projections of a file, which is open only while it is read.

    It holds no handle, so that any thread may read, and nothing stands in the way of writing the
    refined angles. Opening costs about a millisecond.
    """

    path: Path
    shape: tuple[int, int, int]
    conversion: Conversion

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return line integrals (projection, row, column), float32 and finite.

        Raises
        ------
        ScanError
            If the file cannot be read any more.
        """
        with open_file(self.path) as file:
            try:
                return gather(file[DATA], projections, rows, self.conversion)
            except OSError as error:
                found = f"reading {DATA} failed ({error})."
                remedy = "The file is damaged, or its disk is; copy it again from its source."
                raise ScanError(self.path.name, found, remedy) from error


@dataclass(frozen=True)
class ArraySource:
    """Line integrals in an array: anything with a ``shape`` and slices."""

    array: Any
    """(projection, row, column)"""

    def __post_init__(self) -> None:
        if len(self.array.shape) != 3:
            found = f"the shape {tuple(self.array.shape)}; (projection, row, column) is needed."
            raise ScanError("array of line integrals", found)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        n, rows, columns = self.array.shape
        return int(n), int(rows), int(columns)

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return line integrals (projection, row, column), float32 and finite."""
        return gather(self.array, projections, rows, LineIntegrals())


@dataclass(frozen=True)
class BinnedSource:
    """Means of `factor` x `factor` line integrals of another source.

    A remainder at the right and at the bottom is left out.
    """

    source: ProjectionSource
    factor: int

    def __post_init__(self) -> None:
        if not 1 <= self.factor <= min(self.source.shape[1:]):
            raise PipelineError(
                "binning",
                f"{self.factor} for projections of {self.source.shape[1]} x "
                f"{self.source.shape[2]} px; 1 up to the smaller side is needed.",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns, after binning."""
        n, rows, columns = self.source.shape
        return n, rows // self.factor, columns // self.factor

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return line integrals (projection, row, column), float32 and finite."""
        fine = (np.asarray(rows)[:, None] * self.factor + np.arange(self.factor)).ravel()
        columns = self.shape[2]
        out = np.empty((len(projections), len(rows), columns), np.float32)
        block = max(1, BLOCK_PIXELS // max(1, fine.size * self.source.shape[2]))
        for start in range(0, len(projections), block):
            part = self.source.read(projections[start : start + block], fine)
            used = part[..., : columns * self.factor]
            cells = used.reshape(len(part), len(rows), self.factor, columns, self.factor)
            out[start : start + block] = cells.mean(axis=(2, 4))
        return out


def scan_of(projections: Any, theta: Floats) -> Scan:
    """Make a scan of line integrals (n, row, column) in an array, at `theta` (n,) radians.

    Raises
    ------
    ScanError
        If there is not one finite angle for each projection.
    """
    source = ArraySource(projections)
    n = source.shape[0]
    if theta.shape != (n,) or not np.isfinite(theta).all():
        found = f"{theta.shape} angles for {n} projections; one finite angle each is needed."
        raise ScanError("theta", found)
    return Scan(source, theta, np.arange(n), name="array")


def binned(scan: Scan, factor: int) -> Scan:
    """Return `scan` with `factor` x `factor` px averaged into one."""
    if factor == 1:
        return scan
    source = BinnedSource(scan.source, factor)
    return replace(scan, source=source, binning=scan.binning * factor)
