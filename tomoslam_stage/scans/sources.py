"""Where line integrals come from: a file, read lazily, or an array; binned where asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.frames import OfFrames, of_all_frames, shift_in_file
from tomoslam_stage.products import Raw, Scan
from tomoslam_stage.scans.correction import LineIntegrals, Transmission
from tomoslam_stage.scans.dxchange import DATA
from tomoslam_stage.scans.files import open_file
from tomoslam_stage.scans.selection import BLOCK_PIXELS, gather
from tomoslam_stage.scans.theta import MOST_TURNS_RAD

if TYPE_CHECKING:
    from pathlib import Path

    from tomoslam_stage.products import (
        Conversion,
        Floats,
        Integers,
        Pixels,
        ProjectionSource,
        Values,
    )


@dataclass(frozen=True)
class FileSource:
    """Projections of a file, which is open only while it is read.

    It holds no handle, so that any thread may read, and nothing stands in the way of writing the
    refined angles. Opening costs about a millisecond.
    """

    path: Path
    shape: tuple[int, int, int]
    conversion: Conversion | None
    """Makes line integrals; None leaves the values as they are stored."""
    dataset: str = DATA

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return values (projection, row, column), float32; line integrals are finite.

        Raises
        ------
        ScanError
            If the file cannot be read any more.
        """
        with open_file(self.path) as file:
            return gather(file[self.dataset], projections, rows, self.conversion)


@dataclass(frozen=True)
class ConvertedSource:
    """Line integrals of a source that gives what the detector stored."""

    source: ProjectionSource
    conversion: Conversion
    frames: Integers | None = None
    """(n,) index of each projection in the file, as the conversion counts; None: its own."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        return self.source.shape

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return line integrals (projection, row, column), float32 and finite."""
        some, rows = np.asarray(projections), np.asarray(rows)
        return self.converted(self.source.read(some, rows), some, rows)

    def converted(self, raw: Pixels, some: Integers, rows: Integers) -> Pixels:
        """Make line integrals of what is stored (p, r, c); it may be changed in place."""
        return self.conversion(raw, some if self.frames is None else self.frames[some], rows)

    def only(self, chosen: Integers) -> ConvertedSource:
        """Return some of the projections."""
        frames = chosen if self.frames is None else self.frames[chosen]
        return ConvertedSource(ChosenSource(self.source, chosen), self.conversion, frames)


@dataclass(frozen=True)
class ChosenSource:
    """Some of the projections of another source."""

    source: ProjectionSource
    chosen: Integers
    """(n,) their numbers in `source`."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        return len(self.chosen), *self.source.shape[1:]

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return values (projection, row, column), float32, of those chosen."""
        return self.source.read(self.chosen[np.asarray(projections)], rows)


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


@dataclass(frozen=True)
class Stack:
    """A source as an array: it is read where it is sliced, or made a numpy array.

    Slices and lists of indices choose projections and rows; columns are always read whole.
    """

    source: ProjectionSource
    scan: Scan | None = None
    """What it belongs to, where it is one that was opened."""
    dtype: ClassVar[np.dtype[np.float32]] = np.dtype(np.float32)
    ndim: ClassVar[int] = 3

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        return self.source.shape

    def __len__(self) -> int:
        return self.shape[0]

    def for_every_frame(self, theta: Floats, sigma: Floats) -> OfFrames:
        """Return angles (m,) and sigma (m,), radians, for frames that were left out, too.

        See `of_all_frames`; `theta` and `sigma` (n,) are those of the projections.
        """
        if self.scan is None:
            return OfFrames(theta, sigma)
        return of_all_frames(self.scan, theta, sigma)

    def shift_for_every_frame(self, shift: Floats) -> Floats:
        """Return shifts (m,), px of the detector, with NaN for frames that were left out.

        See `shift_in_file`; `shift` (n,) is that of the projections, in their px.
        """
        return shift if self.scan is None else shift_in_file(self.scan, shift)

    def __getitem__(self, index: Any) -> Any:
        """Read what numpy's basic indices name, or lists of projections or rows."""
        named = list(index) if isinstance(index, tuple) else [index]
        if any(each is Ellipsis or each is None for each in named):
            return np.asarray(self)[index]
        first, second, *rest = named + [slice(None)] * (2 - len(named))
        projections = np.arange(self.shape[0])[first]
        rows = np.arange(self.shape[1])[second]
        block = self.source.read(np.atleast_1d(projections), np.atleast_1d(rows))
        whole = [0 if np.ndim(each) == 0 else slice(None) for each in (projections, rows)]
        return block[(*whole, *rest)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        n, rows, _ = self.shape
        return self.source.read(np.arange(n), np.arange(rows)).astype(dtype or self.dtype)


def scan_of(projections: Any, theta: Floats) -> Scan:
    """Make a scan of line integrals (n, row, column) in an array, at `theta` (n,) radians.

    Raises
    ------
    ScanError
        If there is not one finite angle for each projection, or these are no radians.
    """
    source = ArraySource(projections)
    n, turns = source.shape[0], float(np.ptp(theta)) / (2 * np.pi) if theta.size else 0.0
    if turns > MOST_TURNS_RAD:
        found = f"radians are needed, and as such these span {turns:.4g} turns."
        raise ScanError("theta", found, "Pass numpy.radians(theta) if it holds degrees.")
    if theta.shape != (n,) or not np.isfinite(theta).all():
        found = f"{theta.shape} angles for {n} projections; one finite angle each is needed."
        raise ScanError("theta", found)
    return Scan(source, theta, np.arange(n), name="array")


def line_integrals(scan: Scan) -> Scan:
    """Return `scan` with a source of line integrals, which may have been its own all along."""
    if scan.raw is None:
        return scan
    integrals = ConvertedSource(scan.source, scan.raw.conversion, scan.frames)
    return replace(scan, source=integrals, raw=None)


def prepared(scan: Scan, source: ProjectionSource, values: Values) -> Scan:
    """Return `scan` with another source, which holds `values`."""
    if values == "line_integrals":
        finite = ConvertedSource(source, LineIntegrals())
        return replace(scan, source=finite, raw=None)
    raw = scan.raw if values == scan.values else Raw(Transmission())
    return replace(scan, source=source, raw=raw)


def only(scan: Scan, chosen: Integers) -> Scan:
    """Return a scan of some of the projections of `scan`.

    It still knows how many steps the stage made from one of them to the next.
    """
    of_frames = scan.theta if scan.theta_of_frames is None else scan.theta_of_frames
    return replace(
        scan,
        source=ChosenSource(scan.source, chosen),
        theta=scan.theta[chosen],
        frames=scan.frames[chosen],
        theta_of_frames=of_frames,
    )


def binned(scan: Scan, factor: int) -> Scan:
    """Return `scan` with `factor` x `factor` px averaged into one."""
    if factor == 1:
        return scan
    scan = line_integrals(scan)
    source = BinnedSource(scan.source, factor)
    return replace(scan, source=source, binning=scan.binning * factor)
