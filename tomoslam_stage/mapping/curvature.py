"""How the pull of a map answers to the geometry, the map following it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.geometry import TURN
from tomoslam_stage.symmetric import add_gram, add_outer, symmetrise

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Floats, Geometry, Integers, Layout

AMPLITUDE = np.deg2rad(0.1)
"""Radians by which angles are moved to see how the pull answers."""
AXIS_STEP = 0.3
"""Px by which the axis is moved, and the shifts of projections."""
TEETH = 10
"""Places of a comb, 18 degrees apart: so far the answer to each alone is felt."""
PROBES = 40
"""Most combs; of more angles, neighbours are moved together."""
MODES = 3
"""Waves of the half turn that are looked at one by one."""
NOTHING = 0.01
"""Share of an answer that is not worth mixing in."""
LOWEST, HIGHEST = 0.02, 2.0
"""What a secant may teach about any direction, in units of the conditional curvature: a map that
follows lowers it, and nothing raises it."""


@dataclass(frozen=True)
class Place:
    """A geometry, what the rows say there, and how that answers to changes."""

    geometry: Geometry
    look: Look
    curvature: Floats
    """(k, k) squared line integrals."""


def probed(look: Callable[[Geometry], Look], geometry: Geometry, floor: float) -> Place | None:
    """Look at `geometry` and find the curvature there, by finite differences of the whole pull.

    That includes how the map is made. Eigenvalues below `floor`, in units of the conditional
    curvature, are raised to it: smooth changes of the angles are followed by the map, and there
    noise would decide the sign. None where the map is empty, so that nothing answers.
    """
    start, layout = look(geometry), geometry.layout
    if np.delete(start.conditional, layout.roll).min() <= 0:
        return None

    def answer(change: Floats) -> Floats:
        return np.asarray(start.pulls - look(geometry.moved(change)).pulls)

    curvature = _by_projections(answer, geometry, start)
    by_row = answer(AXIS_STEP * np.eye(layout.size)[layout.axis]) / AXIS_STEP
    # A roll moves the axis of each row by its height, and each row has a map of its own.
    curvature[layout.line] = by_row.sum(axis=0), start.heights @ by_row
    for entries in layout.own:
        curvature[entries, layout.line] = curvature[layout.line, entries].T
    curvature[layout.axis, layout.roll] = curvature[layout.roll, layout.axis]
    lift(curvature, start.conditional, floor, layout)
    for wave in _waves(geometry):
        learn(curvature, wave, answer(wave).sum(axis=0), start.conditional)
    return Place(geometry, start, curvature)


def looks_needed(layout: Layout) -> int:
    """Count the looks that `probed` takes."""
    return 2 + len(layout.own) * sum(1 for _ in _combs(layout.n)) + 2 * MODES


def lift(curvature: Floats, conditional: Floats, floor: float, layout: Layout) -> None:
    """Raise eigenvalues of `curvature` (k, k) to `floor`, in units of `conditional` (k,)."""
    from scipy.linalg import eigh

    least = np.full(layout.size, 1e-3 * conditional[layout.angles].mean())
    for entries in layout.own:
        least[entries] = 1e-3 * conditional[entries].mean()
    scale = np.sqrt(np.maximum(conditional, least))
    relative = curvature / scale
    relative /= scale[:, None]
    # Few are so low: all would take much longer, and more memory.
    low = (-np.inf, floor)
    values, vectors = eigh(relative.T, overwrite_a=True, check_finite=False, subset_by_value=low)
    add_gram(curvature, np.sqrt(floor - values)[:, None] * (scale * vectors.T), 1.0)


def learn(curvature: Floats, change: Floats, answer: Floats, conditional: Floats) -> None:
    """Make `curvature @ change` the `answer`, in place: the update of BFGS.

    Damped where the answer is out of bounds, in units of `conditional` (k,): mixed with what
    was known (Nocedal and Wright, Numerical Optimization, 18.14). No change teaches nothing.
    """
    known = curvature @ change
    least, found = change @ known, change @ answer
    if least <= 0:
        return
    lowest = min(LOWEST * (change**2 @ conditional), least / 2)
    share = (least - lowest) / (least - found) if found < lowest else 1.0
    mixed = share * answer + (1 - share) * known
    while mixed**2 @ (1 / conditional) > HIGHEST * (change @ mixed):
        share /= 2
        if share < NOTHING:
            return
        mixed = share * answer + (1 - share) * known
    add_outer(curvature, mixed, 1 / float(change @ mixed))
    add_outer(curvature, known, -1 / float(least))


def _by_projections(answer: Callable[[Floats], Floats], geometry: Geometry, start: Look) -> Floats:
    """(k, k) curvature of angles and, where unknown, shifts, from combs that are moved together.

    Of neighbours that one tooth moves, each has its own conditional curvature; what the map takes
    from it, which is smooth but for the side that shifts are seen from, they share.
    """
    layout, theta = geometry.layout, geometry.theta
    order = np.argsort(np.mod(theta, np.pi), kind="stable")
    known = conditional_curvature(start, layout)
    side = _sides(theta, layout)
    curvature: Floats = known.toarray()
    for entries, step in zip(layout.own, (AMPLITUDE, AXIS_STEP), strict=False):
        for comb in _combs(layout.n):
            moved = entries.start + order[np.concatenate(comb)]
            change = np.zeros(layout.size)
            change[moved] = step * side[moved]
            taken = answer(change).sum(axis=0) / step - known @ (change / step)
            for tooth, near in zip(comb, _nearest(comb, layout.n), strict=True):
                of_tooth = entries.start + order[tooth]
                places = np.concatenate([others.start + order[near] for others in layout.own])
                share = taken[places, None] * side[of_tooth] / len(tooth)
                curvature[np.ix_(places, of_tooth)] += share
    symmetrise(curvature)
    return curvature


def conditional_curvature(look: Look, layout: Layout) -> Any:
    """(k, k) sparse curvature of angles and shifts, were the map to stay as it is."""
    from scipy.sparse import csr_array

    values, rows, columns = [], [], []
    for entries in layout.own:
        for others in layout.own:
            values.append(look.conditional[entries] if others == entries else look.mixed)
            rows.append(np.arange(layout.size)[entries])
            columns.append(np.arange(layout.size)[others])
    where = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), where), (layout.size, layout.size))


def _sides(theta: Floats, layout: Layout) -> Floats:
    """(k,) signs: in the mirror, half a turn on, a shift goes the other way; an angle does not."""
    side = np.ones(layout.size)
    for shifts in layout.own[1:]:
        side[shifts] = np.where(np.mod(theta, TURN) < np.pi, 1.0, -1.0)
    return side


def _combs(n: int) -> Iterator[list[Integers]]:
    """Combs that together move each of `n` places once; each is a list of its teeth's places."""
    starts = np.arange(TEETH + 1) * n // TEETH
    width = -(-n // (TEETH * PROBES))
    for first in range(0, int(np.diff(starts).max()), width):
        teeth = [
            np.arange(start + first, min(start + first + width, end))
            for start, end in pairwise(starts)
        ]
        yield [tooth for tooth in teeth if len(tooth)]


def _nearest(comb: list[Integers], n: int) -> list[Integers]:
    """For each tooth of `comb` the places that are nearest to it, round the half turn."""
    middles = np.array([tooth.mean() for tooth in comb])
    apart = np.abs((np.arange(n)[:, None] - middles + n / 2) % n - n / 2)
    nearest = np.argmin(apart, axis=1)
    return [np.flatnonzero(nearest == tooth) for tooth in range(len(comb))]


def _waves(geometry: Geometry) -> Iterator[Floats]:
    """(k,) changes of the angles that are smooth over the half turn."""
    for k in range(1, MODES + 1):
        for function in (np.cos, np.sin):
            change = np.zeros(geometry.layout.size)
            change[geometry.layout.angles] = AMPLITUDE * function(2 * k * geometry.theta)
            yield change
