"""How sure the pull of a map is, from what its rows and projections disagree about."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import TURN, around

if TYPE_CHECKING:
    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Floats, Geometry, Layout

ORDINARY = 1.3
"""Residual of a projection, in medians, up to which it is nothing special."""
NEAR = np.deg2rad(8)
"""Radians: how near to a projection that does not fit others are doubted with it."""
LEAST_SCATTER = 1e-3
"""Of the mean squared residual: what rows that agree better than noise would let them count as."""


def misfits(squares: Floats, theta: Floats) -> Floats:
    """(n,) residuals of the projections in medians, but for single ones that stand out.

    `squares` (r, n) are mean squared residuals; the median of three goes round the turn.
    """
    from scipy.ndimage import median_filter

    order = around(theta)
    of_all = squares.mean(axis=0)
    smooth = np.empty_like(of_all)
    smooth[order] = median_filter(of_all[order], 3, mode="nearest")
    return np.asarray(smooth / np.median(smooth))


def noise(look: Look, curvature: Floats) -> float:
    """Variance of the pull, in units of the curvature, squared line integrals: rows scatter."""
    n = look.squares.shape[1]
    scatter = len(look.pulls) * look.pulls[:, :n].var(axis=0, ddof=1).mean()
    least = LEAST_SCATTER * look.squares.mean()
    return float(max(scatter / np.diag(curvature)[:n].mean(), least))


def doubts(squares: Floats, geometry: Geometry, scale: float) -> Floats:
    """(k,) factors by which misfit of projections raises the noise of what they say.

    An excess of `scale` medians doubles it; the axis and the roll get the median. Projections near
    one that does not fit are doubted with it: it spoils the map for them.
    """
    over = np.maximum(misfits(squares, geometry.theta) - ORDINARY, 0) / scale
    of_projections = 1 + highest_near(over, geometry.theta) ** 2
    factors = np.full(geometry.layout.size, np.median(of_projections))
    for entries in geometry.layout.own:
        factors[entries] = of_projections
    return factors


def highest_near(values: Floats, theta: Floats) -> Floats:
    """(n,) the highest of `values` (n,) within `NEAR` of each of the angles `theta` (n,)."""
    from scipy.ndimage import maximum_filter1d

    order = around(theta)
    gap = np.ptp(np.mod(theta, TURN)) / max(len(theta) - 1, 1)
    reach = round(NEAR / gap) if gap > 0 else 0
    highest = np.empty_like(values)
    highest[order] = maximum_filter1d(values[order], 2 * reach + 1, mode="nearest")
    return highest


def whitener(curvature: Floats, variance: Floats) -> Floats:
    """(k, k) M such that ``M @ curvature`` is the information and ``M @ pull`` its pull.

    The pull has the covariance ``V^.5 K V^.5`` of the curvature K and the `variance` V (k,), so
    that ``M = K V^-.5 K^-1 V^-.5``.
    """
    if np.ptp(variance) == 0:
        return np.asarray(np.eye(len(variance)) / variance[0])
    root = 1 / np.sqrt(variance)
    return np.asarray(np.linalg.solve(curvature, root[:, None] * curvature).T * root)


def formal_sigma(information: Floats, layout: Layout) -> float:
    """Radians: the median over the angles, with the mean of the angles free."""
    covariance = np.linalg.inv(information)[layout.angles, layout.angles]
    common = covariance.mean(axis=0)
    variance = np.diag(covariance) - 2 * common + common.mean()
    return float(np.sqrt(np.median(np.maximum(variance, 0))))
