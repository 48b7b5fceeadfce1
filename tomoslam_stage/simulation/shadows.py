"""Exact projections and slices of solids, averaged over the area of each pixel.

Both are pictures of a world turned into a frame of (column, row, depth) directions. Only the
pixels of each solid's bounding rectangle are touched, those of many solids at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from tomoslam_stage.products import Floats, Integers
from tomoslam_stage.simulation.bodies import Body, Solids

LATTICE = [((k + 0.5) / 8 - 0.5, ((5 * k + 2) % 8 + 0.5) / 8 - 0.5) for k in range(8)]
"""Column and row of the samples in a pixel, a Fibonacci lattice that is its own point reflection.
An edge along rows or columns crosses it in eight steps, a square grid of nine points in three.
Measured: the centroid of a ball of 5 px is off by 0.003 px rms, that of a wire of 1.2 px by 0.017.
"""

BLOCK = 10_000
"""Pixels worked on at a time, so that their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Frame:
    """Where a picture is taken from."""

    directions: Floats
    """(3, 3) unit vectors (X, Y, Z) of column, row and depth, in the rows."""
    origin: tuple[float, float]
    """Column and row at which the point (0, 0, 0) is seen."""
    shape: tuple[int, int]
    """Rows, columns."""


def projection_directions(theta: float, roll: float) -> Floats:
    """(3, 3) column, row and depth of a projection at `theta`, the axis rolled by `roll`.

    The roll is an exact turn of (u, Y) in the detector: ``column = u cos(roll) + Y sin(roll)``
    and ``row = Y cos(roll) - u sin(roll)``, counted from the axis and the middle row.
    """
    u = np.array([np.cos(theta), 0.0, np.sin(theta)])
    down = np.array([0.0, 1.0, 0.0])
    beam = np.array([-np.sin(theta), 0.0, np.cos(theta)])
    cosine, sine = np.cos(roll), np.sin(roll)
    return np.stack([u * cosine + down * sine, down * cosine - u * sine, beam])


def magnified(group: Solids, directions: Floats, source: float) -> Solids:
    """Return `group` as a cone beam shows it on the plane of the axis.

    A point `d` px behind the axis is seen ``source / (source + d)`` times as large as one on it.
    Each solid is taken to be as far away as its middle, so that its shadow keeps its closed form.

    Parameters
    ----------
    group
        Solids, none of them behind the source.
    directions
        (3, 3) unit vectors of column, row and depth, see `Frame`.
    source
        px from the source to the axis.
    """
    depth = group.centre @ directions[2]
    factor = source / (source + depth)
    along = np.outer(depth, directions[2])
    centre = factor[:, None] * (group.centre - along) + along
    half, density = group.half * factor[:, None], group.density / factor
    return Solids(group.body, centre, group.axes, half, density)


def line_integrals(solids: Iterable[Solids], frame: Frame) -> Floats:
    """(row, column) integrals along the depth of `frame`, mean over each pixel."""
    picture = np.zeros(frame.shape)
    for group in solids:
        shadow = group.body.shadow(group.local(frame.directions))
        _add(picture, group, frame, shadow, group.body.chord)
    return picture


def slice_through(solids: Iterable[Solids], frame: Frame, depth: float) -> Floats:
    """(row, column) attenuation per px at `depth` px, mean over each pixel."""
    picture = np.zeros(frame.shape)
    for group in solids:
        ahead = depth - group.centre @ frame.directions[2]
        met = np.abs(ahead) < group.reach(frame.directions)[:, 2]
        right, down, beam = np.moveaxis(group.chosen(met).local(frame.directions), 2, 0)
        plane = np.stack([right, down, beam * ahead[met, None]]).transpose(0, 2, 1)
        _add(picture, group.chosen(met), frame, plane, partial(_filling, group.body))
    return picture


def _filling(body: Body, plane: Floats, x: Floats, y: Floats) -> Floats:
    """(m,) how the body fills the points `x`, `y` of a plane (3, 3, m) in its own coordinates."""
    right, down, offset = plane
    return body.fill(right * x + down * y + offset)


def _add(
    picture: Floats, group: Solids, frame: Frame, of_each: Floats, value: Callable[..., Floats]
) -> None:
    """Add ``value(of_each[..., solid], x, y)`` to the pixels each solid reaches."""
    middle = (group.centre @ frame.directions.T)[:, :2] + frame.origin
    reach = group.reach(frame.directions)[:, :2]
    for solid, column, row in _covered(middle, reach, frame.shape):
        numbers = of_each[..., solid]
        x, y = column - middle[solid, 0], row - middle[solid, 1]
        total = np.zeros(len(solid))
        for right, down in LATTICE:
            total += value(numbers, x + right, y + down)
        total *= group.density[solid] / len(LATTICE)
        np.add.at(picture.reshape(-1), row * frame.shape[1] + column, total)


def _covered(
    middle: Floats, reach: Floats, shape: tuple[int, int]
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield solid, column and row of the pixels in the bounding rectangles, block by block."""
    size = np.array(shape[::-1])
    low = np.clip(np.ceil(middle - reach - 0.5), 0, size).astype(np.intp)
    high = np.clip(np.floor(middle + reach + 0.5) + 1, low, size).astype(np.intp)
    width, height = (high - low).T
    ends = np.cumsum(width * height)
    total = int(ends[-1]) if len(ends) else 0
    starts = ends - width * height
    for first in range(0, total, BLOCK):
        pixel = np.arange(first, min(first + BLOCK, total))
        solid = np.searchsorted(ends, pixel, side="right")
        down, right = np.divmod(pixel - starts[solid], width[solid])
        yield solid, low[solid, 0] + right, low[solid, 1] + down
