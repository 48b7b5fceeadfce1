"""Angles and the triangle that three projections of a point make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import Floats, Integers

TURN = 2 * np.pi
HAIR = 1e-6
"""Radians: angles that differ by rounding stay on one side of where the turn begins."""
NEAR = np.deg2rad(8)
"""Radians: how near projections show much the same."""
WIDEST_GAP = 8.0
"""Usual gaps between projections that a gap may count as, where angles are weighed."""


def wrapped(angle: Floats) -> Floats:
    """`angle` in radians, moved by whole turns into [-pi, pi)."""
    return np.mod(angle + np.pi, TURN) - np.pi


def within_turn(theta: Floats) -> Floats:
    """(n,) radians: how far into the turn each of `theta` lies, which begins at the least."""
    return np.asarray(np.mod(theta - theta.min(initial=np.inf) + HAIR, TURN))


def around(theta: Floats) -> Integers:
    """(n,) the projections in the order of their angles within the turn."""
    return np.argsort(within_turn(theta), kind="stable")


def partners(theta: Floats, step: float) -> Integers:
    """(n,) for each projection the one that lies `step` radians further on, or -1.

    Whole turns do not count: in a scan over the full turn the last projections have partners among
    the first. The nearest recorded angle is taken; one that misses by more than a fifth of the step
    is none.
    """
    order = around(theta)
    place = within_turn(theta)
    after = np.searchsorted(place[order], np.mod(place + step, TURN)) % len(theta)
    candidates = np.stack([order[after], order[after - 1]])
    miss = np.abs(wrapped(theta[candidates] - theta - step))
    best = np.argmin(miss, axis=0)
    everyone = np.arange(len(theta))
    found = candidates[best, everyone]
    usable = (miss[best, everyone] <= 0.2 * step) & (found != everyone)
    return np.where(usable, found, -1)


def highest_near(values: Floats, theta: Floats) -> Floats:
    """(n,) the highest of `values` (n,) within `NEAR` of each of the angles `theta` (n,)."""
    from scipy.ndimage import maximum_filter1d

    return _near(values, theta, maximum_filter1d)


def mean_near(values: Floats, theta: Floats) -> Floats:
    """(n,) the mean of `values` (n,) within `NEAR` of each of the angles `theta` (n,)."""
    from scipy.ndimage import uniform_filter1d

    return _near(values, theta, uniform_filter1d)


def number_near(theta: Floats) -> int:
    """How many of the angles `theta` (n,) lie within `NEAR` of one of them, itself included."""
    gap = np.ptp(within_turn(theta)) / max(len(theta) - 1, 1)
    return 2 * round(NEAR / gap) + 1 if gap > 0 else 1


def _near(values: Floats, theta: Floats, running: Callable[..., Floats]) -> Floats:
    """(n,) what a filter makes of `values` (n,) within `NEAR` of each of `theta` (n,)."""
    order = around(theta)
    found = np.empty_like(values)
    found[order] = running(values[order], number_near(theta), mode="nearest")
    return found


def angular_weights(theta: Floats) -> Floats:
    """(n,) radians: the share of the half turn that each projection stands for.

    Half the gap to either neighbour, modulo a half turn, of a wedge without projections no more
    than `WIDEST_GAP` allows: the whole of it would give two projections, and their noise, the
    weight of all that are missing. The weights add up to pi all the same, so that flat regions
    keep their value and what is lost is detail across the wedge.
    """
    folded = np.mod(theta, np.pi)
    order = np.argsort(folded, kind="stable")
    gaps = np.diff(folded[order], append=folded[order[0]] + np.pi)
    gaps = np.minimum(gaps, WIDEST_GAP * _usual_gap(gaps))
    weights = np.empty_like(folded)
    weights[order] = (gaps + np.roll(gaps, 1)) / 2
    return np.asarray(weights * (np.pi / weights.sum()))


def _usual_gap(gaps: Floats) -> float:
    """Radians: half of what the gaps span, but for the widest, lies in gaps up to this one.

    Counting them instead would be misled by angles that nearly meet others half a turn on.
    """
    spans = np.sort(gaps)[:-1]
    covered = np.cumsum(spans)
    if len(spans) == 0 or covered[-1] == 0:
        return float(gaps.max())
    return float(spans[np.searchsorted(covered, covered[-1] / 2)])


def triangle_angles(normal: Floats) -> Floats:
    """(m, 2) radians: both steps of triplets from the normals (m, 3) of their features' plane.

    The columns ``(x1, x2, x3)`` of all features lie in one plane, ``m x1 - k x2 + x3 = 0`` with
    ``k = sin(D1 + D2) / sin(D1)`` and ``m = sin(D2) / sin(D1)`` (Griguletskii et al., equation 2).
    So (1, m, k) are the sides of a triangle whose opposite angles are D1, D2 and pi - D1 - D2, and
    the cosine rule gives both. Not a triangle: NaN.
    """
    m, k, one = np.abs(normal).T
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.arccos((m**2 + k**2 - one**2) / (2 * m * k))
        second = np.arccos((one**2 + k**2 - m**2) / (2 * one * k))
    return np.stack([first, second], axis=-1)


def triangle_jacobian(normal: Floats, angles: Floats) -> Floats:
    """(m, 2, 3) derivative of `triangle_angles` with respect to the normal (m, 3).

    From ``dA = a (da - cos(C) db - cos(B) dc) / (b c sin(A))`` for the angle A opposite side a.
    """
    m, k, one = np.abs(normal).T
    first, second = angles.T
    cos_first, cos_second, cos_third = np.cos(first), np.cos(second), -np.cos(first + second)
    for_first = np.stack([-cos_third, -cos_second, np.ones_like(m)]) * one / (m * k * np.sin(first))
    for_second = (
        np.stack([np.ones_like(m), -cos_first, -cos_third]) * m / (one * k * np.sin(second))
    )
    jacobian = np.stack([for_first, for_second]) * np.sign(normal.T)
    return np.moveaxis(jacobian, -1, 0)


def rms(values: Floats) -> float:
    """Root of the mean square of `values`, not counting NaN."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def rms_difference(first: Floats, second: Floats) -> float:
    """Root of the mean square of the difference with its mean removed, as a gauge is free."""
    difference = first - second
    return rms(difference - np.nanmean(difference))


def spread(available: int, count: int) -> Integers:
    """Up to `count` indices of `available` things, evenly spread."""
    return np.unique(np.linspace(0, available - 1, min(count, available)).round().astype(np.intp))


def unseen_shifts(theta: Floats) -> Floats:
    """(n, 3) orthonormal shifts of projections at `theta` (n,) radians that no scan tells.

    A common shift is the axis, and one that goes round with the turn a place of the whole sample.
    """
    modes = np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=1)
    return np.asarray(np.linalg.qr(modes)[0])
