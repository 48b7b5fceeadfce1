"""How sure the pull of a map is, from what its rows and projections disagree about."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import around, highest_near, mean_near
from tomoslam_stage.symmetric import add_gram, factorised, halfway, inverse, solved

if TYPE_CHECKING:
    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Floats, Geometry, Layout

ORDINARY = 1.3
"""Residual of a projection, in medians, up to which it is nothing special."""
UNSTEADY = 0.007
"""Px along the columns by which a projection may be out of place in all rows alike, so that no row
tells it from a turn. Chosen on simulated boards, whose angles jittered or drifted."""
LEAST_SCATTER = 1e-3
"""Of the mean squared residual: what rows that agree better than noise would let them count as."""


def misfits(look: Look, theta: Floats) -> Floats:
    """(n,) residuals of the projections in medians, but for single ones that stand out.

    The median of three goes round the turn. Rows that were smoothed, and freed of what is fixed to
    the detector, show what does not fit above less noise; it is told as rows would show it that
    were not.
    """
    from scipy.ndimage import median_filter

    order = around(theta)
    of_all = look.squares.mean(axis=0) + look.fixed
    smooth = np.empty_like(of_all)
    smooth[order] = median_filter(of_all[order], 3, mode="nearest")
    return np.asarray(1 + look.noise_left * (smooth / np.median(smooth) - 1))


def noise(look: Look, curvature: Floats) -> Floats:
    """(n,) variance of the pull of each angle, in units of the curvature: rows scatter.

    Squared line integrals.
    """
    n = look.squares.shape[1]
    scatter = len(look.pulls) * look.pulls[:, :n].var(axis=0, ddof=1)
    least = LEAST_SCATTER * look.squares.mean()
    return np.asarray(np.maximum(scatter / np.diag(curvature)[:n], least))


def variances(look: Look, geometry: Geometry, curvature: Floats, scale: float) -> Floats:
    """(k,) variance of the pull, in units of the curvature, squared line integrals.

    Where projections are thick, seen edge on, what a map cannot show differs from row to row, and
    the rows scatter ten times as much as elsewhere. Face on, a turn of a flat object is next to a
    shift, and what shifts a projection turns it, unless shifts are unknown themselves. Misfit of
    `scale` medians raises it further, see `doubts`. The axis and the roll get the median.
    """
    each = noise(look, curvature)
    if "shift" not in geometry.unknowns:
        each += (UNSTEADY * look.mixed) ** 2 / np.diag(curvature)[: len(each)]
    of_projections = mean_near(each, geometry.theta) * doubts(look, geometry.theta, scale)
    found = np.full(geometry.layout.size, np.median(of_projections))
    for entries in geometry.layout.own:
        found[entries] = of_projections
    return found


def doubts(look: Look, theta: Floats, scale: float) -> Floats:
    """(n,) factors by which misfit of projections raises the noise of what they say.

    An excess of `scale` medians doubles it. Projections near one that does not fit are doubted
    with it: it spoils the map for them.
    """
    over = np.maximum(misfits(look, theta) - ORDINARY, 0) / scale
    return np.asarray(1 + highest_near(over, theta) ** 2)


def whitened(curvature: Floats, variance: Floats, pulls: Floats) -> tuple[Floats, Floats]:
    """(k, k) information, and the `pulls` (m, k) that go with it, in standard deviations.

    The pull has the covariance ``V^.5 K V^.5`` of the curvature K and the `variance` V (k,), so
    that the information is ``K V^-.5 K^-1 V^-.5 K``, and its pulls ``K V^-.5 K^-1 V^-.5`` times
    those of the curvature.
    """
    if np.ptp(variance) == 0:
        return curvature / variance[0], pulls / variance[0]
    half, told = _halved(curvature, 1 / np.sqrt(variance), pulls)
    information = np.zeros_like(curvature)
    add_gram(information, half, 1.0)
    return information, told


def _halved(curvature: Floats, weights: Floats, pulls: Floats) -> tuple[Floats, Floats]:
    """(k, k) H of the information H' H of `whitened`, and its pulls (m, k)."""
    root = factorised(curvature.copy())
    told = curvature @ (weights[:, None] * solved(root, (weights * pulls).T))
    return halfway(root, weights[:, None] * curvature), np.asarray(told.T)


def formal_sigma(information: Floats, layout: Layout) -> float:
    """Radians: the median over the angles, with the mean of the angles free."""
    root, mean = factorised(information.copy()), np.zeros(layout.size)
    mean[layout.angles] = 1 / layout.n
    common = solved(root, mean)[layout.angles]
    variance = np.diag(inverse(root))[layout.angles] - 2 * common + common.mean()
    return float(np.sqrt(np.median(np.maximum(variance, 0))))
