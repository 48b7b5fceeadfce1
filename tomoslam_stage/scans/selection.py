"""Reading chosen projections and rows of a large array in bounded, contiguous pieces.

HDF5 is fast at slices and slow at lists of indices, which it also wants sorted and unique. Here
any list is answered by few slices: neighbours share one, and no piece is larger than
`BLOCK_PIXELS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from tomoslam_stage.products import Conversion, Floats, Integers, Pixels

BLOCK_PIXELS = 1 << 22
NEAR_ROWS = 8
"""Reading this many rows along costs less than a second look-up, where there are no chunks."""


def gather(
    array: Any,
    projections: Integers,
    rows: Integers,
    convert: Conversion | None = None,
) -> Pixels:
    """Read, convert and return the chosen projections and rows, in the order asked for.

    Parameters
    ----------
    array
        (n, r, c); anything with ``shape`` and slices: an h5py dataset, a numpy or dask array.
    projections, rows
        Indices in any order, repeats allowed.
    convert
        Makes line integrals of a block (p, r, c), given the block's projections and rows; without
        it values stay as they are stored.
    """
    wanted, back = np.unique(projections, return_inverse=True)
    kept_rows, rows_back = np.unique(rows, return_inverse=True)
    _check_inside(wanted, array.shape[0], "projections")
    _check_inside(kept_rows, array.shape[1], "rows")
    chunk = _chunk(array)
    bands = list(pieces(kept_rows, chunk[1], array.shape[1]))
    height = max((np.ptp(kept_rows[band]) + 1 for band in bands), default=1)
    longest = max(chunk[0], BLOCK_PIXELS // (int(height) * array.shape[2]))
    out = np.empty((len(wanted), len(kept_rows), array.shape[2]), np.float32)
    for part in pieces(wanted, chunk[0], longest):
        raw = _read(array, wanted[part], kept_rows, bands)
        out[part] = raw if convert is None else convert(raw, wanted[part], kept_rows)
    return _ordered(_ordered(out, back, axis=0), rows_back, axis=1)


def pieces(indices: Integers, gap: int, longest: int) -> Iterator[slice]:
    """Cut sorted, unique `indices` into slices of near neighbours.

    Parameters
    ----------
    indices
        (n,) sorted, unique.
    gap
        Neighbours closer than this share a slice: what lies between is read anyway.
    longest
        No slice reaches over more indices of the array than this.
    """
    start = 0
    for i in range(1, len(indices) + 1):
        if (
            i == len(indices)
            or indices[i] - indices[i - 1] > gap
            or indices[i] - indices[start] >= longest
        ):
            yield slice(start, i)
            start = i


def _chunk(array: Any) -> tuple[int, ...]:
    """Shape of what is read at once; dask has its own word for it, and chunks that differ."""
    own = getattr(array, "chunksize", None) or getattr(array, "chunks", None)
    return own or (1, NEAR_ROWS, 1)


def _read(array: Any, projections: Integers, rows: Integers, bands: list[slice]) -> Pixels:
    """Read the block of (near neighbouring) projections as float32, one band of rows a time."""
    first, last = int(projections[0]), int(projections[-1]) + 1
    raw = np.empty((len(projections), len(rows), array.shape[2]), np.float32)
    for band in bands:
        low, high = int(rows[band][0]), int(rows[band][-1]) + 1
        block: NDArray[Any] = np.asarray(array[first:last, low:high, :])
        raw[:, band] = block[np.ix_(projections - first, rows[band] - low)]
    return raw


def _ordered(block: Pixels, back: Integers, axis: int) -> Pixels:
    """Undo `np.unique`, without a copy where the order was right already."""
    if len(back) == block.shape[axis] and np.array_equal(back, np.arange(len(back))):
        return block
    return np.take(block, back, axis=axis)


def _check_inside(indices: Integers, size: int, what: str) -> None:
    if len(indices) and (indices[0] < 0 or indices[-1] >= size):
        raise IndexError(f"{what} {indices[0]} to {indices[-1]} of {size} were asked for")


def filled(block: Pixels) -> Pixels:
    """Replace what is not finite by interpolation along its detector row; in place.

    A row without a single good pixel becomes 0.

    Parameters
    ----------
    block
        (..., columns).
    """
    lines = block.reshape(-1, block.shape[-1])
    broken = np.flatnonzero(~np.isfinite(lines).all(axis=1))
    for start in range(0, len(broken), 4096):
        part = broken[start : start + 4096]
        lines[part] = _interpolated(lines[part])
    return block


def _interpolated(lines: Pixels) -> Floats:
    """Fill the gaps of (l, c) lines from the nearest good pixel on either side."""
    width = lines.shape[1]
    good, column = np.isfinite(lines), np.arange(width)
    left = np.maximum.accumulate(np.where(good, column, -1), axis=1)
    right = np.minimum.accumulate(np.where(good, column, width)[:, ::-1], axis=1)[:, ::-1]
    only_right, only_left = left < 0, right >= width
    left = np.where(only_right, np.minimum(right, width - 1), left)
    right = np.where(only_left, left, right)
    weight = (column - left) / np.maximum(right - left, 1)
    clean = np.where(good, lines, 0).astype(np.float64)
    a, b = np.take_along_axis(clean, left, 1), np.take_along_axis(clean, right, 1)
    return np.asarray(a + weight * (b - a))
