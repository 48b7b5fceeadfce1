"""Prepared projections in a temporary file: no more than a block of them is ever in memory."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tomoslam_stage.progress import progress
from tomoslam_stage.scans.fresh import translated
from tomoslam_stage.scans.selection import BLOCK_PIXELS, gather

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tomoslam_stage.products import Along, Integers, Pixels, ProjectionSource

CHUNK_PROJECTIONS, CHUNK_ROWS = 16, 16
"""Of a chunk in the file: reading by projection and reading by row cost about the same."""


class Preparation(Protocol):
    """Changes the values of a block of projections."""

    def __call__(self, block: Pixels, rows: Integers) -> Pixels:
        """Return a block (p, r, column) of the same shape; `rows` (r,) says which rows it has."""
        ...


@dataclass(frozen=True)
class Spool:
    """Projections in a temporary file that is gone when nothing refers to it any more."""

    file: Any
    """Open; HDF5 closes the dataset with it."""
    dataset: Any
    """(projection, row, column)"""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        n, rows, columns = self.dataset.shape
        return int(n), int(rows), int(columns)

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Return values (projection, row, column), float32."""
        return gather(self.dataset, projections, rows)


def blocks(shape: tuple[int, int, int], along: Along) -> Iterator[tuple[Integers, Integers]]:
    """Yield projections and rows of each block of a stack of `shape` (n, row, column).

    A block has at most `BLOCK_PIXELS` pixels, but one projection or one row in any case, and
    otherwise whole chunks of a `Spool`.
    """
    n, rows, columns = shape
    if along == "projection":
        length = whole_chunks(BLOCK_PIXELS // (rows * columns), CHUNK_PROJECTIONS)
        for start in range(0, n, length):
            yield np.arange(start, min(n, start + length)), np.arange(rows)
    else:
        length = whole_chunks(BLOCK_PIXELS // (n * columns), CHUNK_ROWS)
        for start in range(0, rows, length):
            yield np.arange(n), np.arange(start, min(rows, start + length))


def whole_chunks(length: int, chunk: int) -> int:
    """Return `length` cut to whole chunks where it is longer than one; at least 1."""
    return max(1, length if length < chunk else length // chunk * chunk)


def spooled(
    source: ProjectionSource, prepare: Preparation, along: Along, what: str, folder: Path
) -> Spool:
    """Prepare all blocks of `source` one after the other into a temporary file in `folder`.

    The file has no name, so that nothing of it is left when the process ends, however it ends.

    Raises
    ------
    ScanError
        If the file cannot be written, as on a full disk.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pieces = list(blocks(source.shape, along))
    with translated(folder / "temporary file"):
        spool = _fresh(source.shape, folder)
        for projections, rows in progress(pieces, what, len(pieces)):
            prepared = prepare(source.read(projections, rows), rows)
            first, last = projections[[0, -1]]
            spool.dataset[first : last + 1, rows[0] : rows[-1] + 1] = prepared
        spool.file.flush()
    return spool


def _fresh(shape: tuple[int, int, int], folder: Path) -> Spool:
    import h5py

    n, rows, columns = shape
    chunks = (min(n, CHUNK_PROJECTIONS), min(rows, CHUNK_ROWS), columns)
    with tempfile.TemporaryDirectory(prefix=".prepared-", dir=folder) as place:
        # Its name goes with the folder; the data stay until the last handle is closed.
        file = h5py.File(Path(place) / "projections.h5", "x")
        return Spool(file, file.create_dataset("data", shape, np.float32, chunks=chunks))
