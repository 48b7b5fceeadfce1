"""The factor graph of sources that speak about all angles at once.

A map, or features that were eliminated, tie every angle to every other: their information matrices
are full. The graph then has few variables: all angles (key 0), the axis with its roll (key 1) and,
where they are unknown, all shifts (key 2). Encoder, prior and CV factors act on the first, the
sources on all of them. What is held is in none of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tomoslam_stage.products import Quadratic

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tomoslam_stage.products import Floats, Geometry, Integers, Layout
    from tomoslam_stage.refinement.factors import Block

ANGLES, AXIS, SHIFTS = 0, 1, 2
"""Keys of the variables: changes of all angles, radians; of the axis, px, and roll, radians; of all
shifts, px."""
AXIS_SIGMA_PX, ROLL_SIGMA_DEG = 0.5, 0.3
"""How far the axis may lie from where the recorded angles put it, and how far it may lean."""


Rows: TypeAlias = tuple["Floats", "Floats"]
"""Whitened Jacobian (m, n) by the angles, and what is wanted of their change (m,)."""


@dataclass(frozen=True)
class Joint:
    """The graph, and which entries of a change its variables are."""

    graph: Any
    """The `gtsam.GaussianFactorGraph`."""
    layout: Layout
    """Of changes."""
    variables: Mapping[int, Integers]
    """By key: (v,) numbers of the entries of a change."""


def joint_graph(
    rows: Sequence[Rows],
    recorded: Geometry,
    here: Geometry,
    quadratics: Sequence[Quadratic],
    shift_px: float,
) -> Joint:
    """Return the graph on changes of the geometry `here`.

    `rows` are the factors on the angles alone. The recorded axis holds the axis loosely, and the
    roll is small; shifts are those of a sample that jitters by `shift_px`, which holds what nobody
    sees of them: a common one is the axis, one round the turn a place of the whole sample.
    """
    import gtsam

    graph, layout = gtsam.GaussianFactorGraph(), here.layout
    for jacobian, right in rows:
        if len(right):
            unit = gtsam.noiseModel.Unit.Create(len(right))
            graph.add(gtsam.JacobianFactor(ANGLES, jacobian, right, unit))
    entries = {ANGLES: layout.angles, AXIS: layout.line, SHIFTS: layout.shifts}
    free = {key: layout.free(some) for key, some in entries.items()}
    variables = {key: some for key, some in free.items() if len(some)}
    sigmas = np.full(layout.size, shift_px)
    sigmas[layout.line] = AXIS_SIGMA_PX, np.deg2rad(ROLL_SIGMA_DEG)
    back = recorded.since(here)
    for key, some in variables.items():
        if key != ANGLES:
            loose = gtsam.noiseModel.Diagonal.Sigmas(sigmas[some])
            graph.add(gtsam.JacobianFactor(key, np.eye(len(some)), back[some], loose))
    factor: Any = gtsam.HessianFactor
    for quadratic in quadratics:
        parts = in_parts(without_common_angle(quadratic, layout), list(variables.values()))
        graph.add(factor(*variables, *parts, 0))
    return Joint(graph, layout, variables)


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


def without_common_angle(quadratic: Quadratic, layout: Layout) -> Quadratic:
    """Take out what a source seems to say about a turn of all angles together: nobody sees it."""
    angles = layout.angles
    information, pull = quadratic.information.copy(), quadratic.pull.copy()
    information[angles] -= information[angles].mean(axis=0)
    information[:, angles] -= information[:, angles].mean(axis=1, keepdims=True)
    pull[angles] -= pull[angles].mean()
    return Quadratic(information, pull)


def in_parts(quadratic: Quadratic, variables: Sequence[Integers]) -> list[Floats]:
    """Cut a quadratic as gtsam's Hessian factor takes it: G11, G12, ..., g1, G22, ..., g2, ..."""
    parts = []
    for number, some in enumerate(variables):
        parts += [quadratic.information[np.ix_(some, other)] for other in variables[number:]]
        parts.append(quadratic.pull[some])
    return parts


def change_of(joint: Joint) -> Floats:
    """(k,) the change that the graph wants most; none of what is held."""
    solution = joint.graph.optimize()
    change = np.zeros(joint.layout.size)
    for key, some in joint.variables.items():
        change[some] = solution.at(key)
    return change


def covariance_of(joint: Joint) -> Floats:
    """(k, k) of the change that the graph wants; zeros of what is held."""
    hessian, _ = joint.graph.hessian()
    covariance = np.zeros((joint.layout.size,) * 2)
    some = np.concatenate(list(joint.variables.values()))
    covariance[np.ix_(some, some)] = np.linalg.inv(hessian)
    return covariance
