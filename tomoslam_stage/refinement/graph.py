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


def solve_dense(information: Floats, pull: Floats) -> Floats:
    """(v,) what a graph of one variable wants, all of whose entries hang together.

    Parameters
    ----------
    information
        (v, v), as a Hessian factor takes it.
    pull
        (v,)

    Raises
    ------
    LinAlgError
        If something is held by nothing.
    """
    import gtsam

    graph, everything = gtsam.GaussianFactorGraph(), 0
    graph.add(gtsam.HessianFactor(everything, information, pull, 0.0))
    try:
        return np.asarray(graph.optimize().at(everything))
    except RuntimeError as indeterminate:
        raise np.linalg.LinAlgError(str(indeterminate)) from None


def normal_equations(graph: Any, count: int) -> tuple[Any, Floats]:
    """(n, n) information of all `count` angles, sparse (COO), and their pull (n,)."""
    from scipy.sparse import csr_matrix

    # gtsam counts from 1, and only the keys that there are; what is wanted comes last.
    *where, values = graph.sparseJacobian_()
    rows, columns = (np.asarray(one, np.intp) - 1 for one in where)
    entries = np.append(graph.keyVector(), count)[columns]
    whole = csr_matrix((values, (rows, entries)), (rows.max() + 1, count + 1))
    jacobian, wanted = whole[:, :count], whole[:, count].toarray()[:, 0]
    return (jacobian.T @ jacobian).tocoo(), np.asarray(jacobian.T @ wanted)


def marginal_sigma(graph: Any, count: int) -> Floats:
    """(n,) radians: one standard deviation of each angle, from the graph's marginals."""
    import gtsam

    marginals = gtsam.Marginals(graph, graph.optimize())
    variances = [marginals.marginalCovariance(key)[0, 0] for key in range(count)]
    return np.asarray(np.sqrt(variances))
