"""The factor graph of sources that speak about all angles at once.

A map, or features that were eliminated, tie every angle to every other: their information matrices
are full. The graph then has two variables, all angles (key 0) and the axis with its roll (key 1);
encoder, prior and CV factors act on the first, the sources on both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tomoslam_stage.products import Quadratic

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tomoslam_stage.products import Floats, Geometry
    from tomoslam_stage.refinement.factors import Block

ANGLES, AXIS = 0, 1
"""Keys of the variables: changes of all angles, radians; of the axis, px, and roll, radians."""
AXIS_SIGMA_PX, ROLL_SIGMA_DEG = 0.5, 0.3
"""How far the axis may lie from where the recorded angles put it, and how far it may lean."""


Rows: TypeAlias = tuple["Floats", "Floats"]
"""Whitened Jacobian (m, n) by the angles, and what is wanted of their change (m,)."""


def joint_graph(
    rows: Sequence[Rows], recorded: Geometry, here: Geometry, quadratics: Sequence[Quadratic]
) -> Any:
    """Return the `gtsam.GaussianFactorGraph` on changes of the geometry `here`.

    `rows` are the factors on the angles alone, the recorded axis holds the axis loosely.
    """
    import gtsam

    graph = gtsam.GaussianFactorGraph()
    for jacobian, right in rows:
        if len(right):
            unit = gtsam.noiseModel.Unit.Create(len(right))
            graph.add(gtsam.JacobianFactor(ANGLES, jacobian, right, unit))
    loose = gtsam.noiseModel.Diagonal.Sigmas([AXIS_SIGMA_PX, np.deg2rad(ROLL_SIGMA_DEG)])
    graph.add(gtsam.JacobianFactor(AXIS, np.eye(2), recorded.since(here)[-2:], loose))
    for quadratic in quadratics:
        graph.add(gtsam.HessianFactor(ANGLES, AXIS, *in_parts(without_common_angle(quadratic)), 0))
    return graph


def stacked(block: Block, theta: Floats) -> Rows:
    """Put all factors of a block below each other, robustly weighted at `theta` (n,)."""
    root = np.sqrt(block.weights(theta))[:, None, None] * block.whitening
    parts = root @ block.jacobian  # (f, d, k)
    factors, dimensions, _ = parts.shape
    jacobian = np.zeros((factors, dimensions, len(theta)))
    which = np.arange(factors)[:, None, None], np.arange(dimensions)[None, :, None]
    np.add.at(jacobian, (*which, block.projections[:, None, :]), parts)
    right = -np.einsum("fij,fj->fi", root, block.residuals(theta))
    return jacobian.reshape(-1, len(theta)), right.ravel()


def without_common_angle(quadratic: Quadratic) -> Quadratic:
    """Take out what a source seems to say about a turn of all angles together: nobody sees it."""
    n = len(quadratic.pull) - 2
    information, pull = quadratic.information.copy(), quadratic.pull.copy()
    information[:n] -= information[:n].mean(axis=0)
    information[:, :n] -= information[:, :n].mean(axis=1, keepdims=True)
    pull[:n] -= pull[:n].mean()
    return Quadratic(information, pull)


def in_parts(quadratic: Quadratic) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Cut a quadratic as gtsam's Hessian factor takes it: G11, G12, g1, G22, g2."""
    full, pull = quadratic.information, quadratic.pull
    return full[:-2, :-2], full[:-2, -2:], pull[:-2], full[-2:, -2:], pull[-2:]


def change_of(graph: Any) -> Floats:
    """(n + 2,) the change that the graph wants most."""
    solution = graph.optimize()
    return np.concatenate([solution.at(ANGLES), solution.at(AXIS)])


def covariance_of(graph: Any) -> Floats:
    """(n + 2, n + 2) of the change that the graph wants."""
    hessian, _ = graph.hessian()
    return np.asarray(np.linalg.inv(hessian))
