"""The factor graph: blocks of factors put into gtsam, solved, and asked how sure it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products import Floats
    from tomoslam_stage.refinement.factors import Block


def linear_graph(blocks: Mapping[str, Block], weights: Mapping[str, Floats], theta: Floats) -> Any:
    """Return the `gtsam.GaussianFactorGraph` on the corrections of `theta` (n,).

    The variables are the paper's ``delta theta`` (its equations 5 and 6): keys are the numbers of
    the projections. Factors are whitened beforehand, so that all share one unit noise model.
    """
    import gtsam

    graph = gtsam.GaussianFactorGraph()
    factor: Any = gtsam.JacobianFactor
    for name, block in blocks.items():
        root = np.sqrt(weights[name])[:, None, None] * block.whitening
        # Columns of each whitened Jacobian, (angle, factor, dimension, 1), as gtsam wants them.
        columns = np.moveaxis(root @ block.jacobian, -1, 0)[..., None]
        target = -np.einsum("fij,fj->fi", root, block.residuals(theta))
        unit = gtsam.noiseModel.Unit.Create(target.shape[1])
        for keys, *parts, right in zip(block.projections.tolist(), *columns, target, strict=True):
            interleaved = [part for pair in zip(keys, parts, strict=True) for part in pair]
            graph.add(factor(*interleaved, right, unit))
    return graph


def solve_once(graph: Any, count: int) -> Floats:
    """(n,) radians: the corrections of all `count` angles that the graph wants most."""
    solution = graph.optimize()
    return np.array([solution.at(key)[0] for key in range(count)])


def marginal_sigma(graph: Any, count: int) -> Floats:
    """(n,) radians: one standard deviation of each angle, from the graph's marginals."""
    import gtsam

    marginals = gtsam.Marginals(graph, graph.optimize())
    variances = [marginals.marginalCovariance(key)[0, 0] for key in range(count)]
    return np.asarray(np.sqrt(variances))
