"""How sure the pull of a map is, from what its rows and projections disagree about."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import around

if TYPE_CHECKING:
    from tomoslam_stage.mapping.looking import Look
    from tomoslam_stage.products import Floats

ORDINARY = 1.3
"""Residual of a projection, in medians, up to which it is nothing special."""
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


def doubts(squares: Floats, theta: Floats, scale: float) -> Floats:
    """(n + 2,) factors by which misfit of projections raises the noise of what they say.

    An excess of `scale` medians doubles it; the axis and the roll get the median.
    """
    over = np.maximum(misfits(squares, theta) - ORDINARY, 0) / scale
    factors = 1 + over**2
    return np.append(factors, np.full(2, np.median(factors)))


def whitener(curvature: Floats, variance: Floats) -> Floats:
    """(n + 2, n + 2) M such that ``M @ curvature`` is the information and ``M @ pull`` its pull.

    The pull has the covariance ``V^.5 K V^.5`` of the curvature K and the `variance` V (n + 2,), so
    that ``M = K V^-.5 K^-1 V^-.5``.
    """
    if np.ptp(variance) == 0:
        return np.asarray(np.eye(len(variance)) / variance[0])
    root = 1 / np.sqrt(variance)
    return np.asarray(np.linalg.solve(curvature, root[:, None] * curvature).T * root)


def formal_sigma(information: Floats) -> float:
    """Radians: the median over the angles, with the mean of the angles free."""
    n = len(information) - 2
    covariance = np.linalg.inv(information)[:n, :n]
    common = covariance.mean(axis=0)
    variance = np.diag(covariance) - 2 * common + common.mean()
    return float(np.sqrt(np.median(np.maximum(variance, 0))))
