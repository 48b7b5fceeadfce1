"""How the pull of a map answers to the geometry, the map following it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Floats, Geometry, Integers

AMPLITUDE = np.deg2rad(0.1)
"""Radians by which angles are moved to see how the pull answers."""
AXIS_STEP = 0.3
"""Px by which the axis is moved."""
TEETH = 10
"""Places of a comb, 18 degrees apart: so far the answer to each alone is felt."""
PROBES = 40
"""Most combs; of more angles, neighbours are moved together."""
MODES = 3
"""Waves of the half turn that are looked at one by one."""
DAMPING = 0.02
"""Least share of its curvature that a secant leaves a direction (Powell)."""


@dataclass(frozen=True)
class Place:
    """A geometry, what the rows say there, and how that answers to changes."""

    geometry: Geometry
    look: Look
    curvature: Floats
    """(n + 2, n + 2) squared line integrals."""


def probed(look: Callable[[Geometry], Look], geometry: Geometry, floor: float) -> Place | None:
    """Look at `geometry` and find the curvature there, by finite differences of the whole pull.

    That includes how the map is made. Eigenvalues below `floor`, in units of the conditional
    curvature, are raised to it: smooth changes of the angles are followed by the map, and there
    noise would decide the sign. None where the map is empty, so that nothing answers.
    """
    start = look(geometry)
    if start.conditional[:-1].min() <= 0:
        return None
    n = len(geometry.theta)

    def answer(change: Floats) -> Floats:
        return np.asarray(start.pulls - look(geometry.moved(change)).pulls)

    curvature = np.zeros((n + 2, n + 2))
    curvature[:n, :n] = _by_angles(answer, geometry.theta, start.conditional[:n])
    by_row = answer(AXIS_STEP * np.eye(n + 2)[n]) / AXIS_STEP
    # A roll moves the axis of each row by its height, and each row has a map of its own.
    curvature[n:] = by_row.sum(axis=0), start.heights @ by_row
    curvature[:n, n:] = curvature[n:, :n].T
    curvature[n, n + 1] = curvature[n + 1, n]
    curvature = raised(curvature, start.conditional, floor)
    for wave in _waves(geometry.theta):
        curvature = secant(curvature, wave, answer(wave).sum(axis=0))
    return Place(geometry, start, curvature)


def looks_needed(n: int) -> int:
    """Count the looks that `probed` takes for `n` angles."""
    return 2 + sum(1 for _ in _combs(n)) + 2 * MODES


def raised(curvature: Floats, conditional: Floats, floor: float) -> Floats:
    """`curvature`, no eigenvalue of it below `floor`, in units of `conditional` (n + 2,)."""
    scale = np.sqrt(np.maximum(conditional, 1e-3 * conditional[:-2].mean()))
    values, vectors = np.linalg.eigh(curvature / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, floor)) @ vectors.T * np.outer(scale, scale))


def secant(curvature: Floats, change: Floats, answer: Floats) -> Floats:
    """`curvature` such that ``curvature @ change`` is `answer`: the update of BFGS.

    Damped where the answer hardly rises (Nocedal and Wright, Numerical Optimization, 18.14); no
    change at all teaches nothing.
    """
    known = curvature @ change
    least, found = change @ known, change @ answer
    if least <= 0:
        return curvature
    if found <= DAMPING * least:
        share = (1 - DAMPING) * least / (least - found)
        answer = share * answer + (1 - share) * known
        found = change @ answer
    update = np.outer(answer, answer) / found - np.outer(known, known) / least
    return np.asarray(curvature + update)


def _by_angles(answer: Callable[[Floats], Floats], theta: Floats, conditional: Floats) -> Floats:
    """(n, n) curvature of the angles, from combs of them that are moved together.

    Of neighbours that one tooth moves, each has its own conditional curvature; what the map takes
    from it, which is smooth, they share.
    """
    n = len(theta)
    order = np.argsort(np.mod(theta, np.pi), kind="stable")
    curvature = np.diag(conditional)
    for comb in _combs(n):
        moved = order[np.concatenate(comb)]
        change = np.zeros(n + 2)
        change[moved] = AMPLITUDE
        taken = answer(change).sum(axis=0)[:n] / AMPLITUDE
        taken[moved] -= conditional[moved]
        for tooth, near in zip(comb, _nearest(comb, n), strict=True):
            curvature[np.ix_(order[near], order[tooth])] += taken[order[near], None] / len(tooth)
    return (curvature + curvature.T) / 2


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


def _waves(theta: Floats) -> Iterator[Floats]:
    """(n + 2,) changes of the angles that are smooth over the half turn."""
    for k in range(1, MODES + 1):
        for function in (np.cos, np.sin):
            yield np.append(AMPLITUDE * function(2 * k * theta), [0.0, 0.0])
