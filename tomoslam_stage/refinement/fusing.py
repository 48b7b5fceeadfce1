"""Several sources of angle measurements in one graph, and what each of them is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import rms, rms_difference
from tomoslam_stage.products import Floats, Geometry, Quadratic, Solve
from tomoslam_stage.refinement.joint import change_of, covariance_of, without_common_angle

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Layout
    from tomoslam_stage.refinement.graphing import FactorGraph

ROUNDS = 20
"""At most so many rounds of weighing; the sources are quadratic, only the weights change."""
SETTLED_DEG = 1e-4
"""A change of all angles that counts as none."""


@dataclass(frozen=True)
class Said:
    """What one source found, on its own but for the encoder."""

    geometry: Geometry
    """Where it ended."""
    quadratic: Quadratic
    """What it says there."""
    halves: Floats
    """(k,) pull of one half of its data less that of the other."""
    biases: Floats
    """(b, k) pull that each of its own assumptions may have added."""


@dataclass(frozen=True)
class Fused:
    """The angles that all sources used agree on."""

    geometry: Geometry
    covariance: Floats
    """(n, n) radians squared, the common angle taken out."""
    halves: Floats
    """(s, n) radians: for each source how its halves would move the angles, common angle out."""
    bias: Floats
    """(n,) radians: how the assumptions of the sources may have moved the angles."""
    residuals: Mapping[str, Floats]
    """By name of the factor: radians."""

    @property
    def half_error(self) -> float:
        """Radians, rms: the error of the angles as the halves of all sources show it."""
        return float(np.sqrt(sum(rms(each) ** 2 for each in self.halves)))

    @property
    def sigma(self) -> Floats:
        """(n,) radians: one standard deviation, no smaller than halves and assumptions show."""
        formal = np.sqrt(np.diag(self.covariance))
        excess = max(1.0, self.half_error / rms(formal)) if rms(formal) > 0 else 1.0
        return np.asarray(np.hypot(excess * formal, self.bias))


def fused(
    graph: FactorGraph,
    recorded: Geometry,
    measurements: AngleMeasurements,
    said: Sequence[Said],
) -> Fused:
    """Solve the graph of encoder, prior, CV factors and all that was `said`.

    Parameters
    ----------
    graph
        The factors.
    recorded
        The recorded angles, and the axis that suits them.
    measurements
        Of triplets, for CV factors; may be none.
    said
        The sources; the first tells where the others are told from.
    """
    here = said[0].geometry
    # The graph does not hear of a common angle; told from elsewhere, a source must not speak of it.
    heard = [without_common_angle(each.quadratic, here.layout) for each in said]
    told = [q.after(here.since(each.geometry)) for q, each in zip(heard, said, strict=True)]
    for _ in range(ROUNDS):
        wanted = graph.joint(recorded, measurements, here, told)
        change = change_of(wanted)
        here, told = here.moved(change), [quadratic.after(change) for quadratic in told]
        if np.abs(change[here.layout.angles]).max() < np.deg2rad(SETTLED_DEG):
            break
    wanted = graph.joint(recorded, measurements, here, told)
    covariance = covariance_of(wanted)
    blocks = {name: f.block(recorded.theta, measurements) for name, f in graph.factors.items()}
    assumed = (moved_by(covariance, pull, here.layout) for each in said for pull in each.biases)
    return Fused(
        geometry=here,
        covariance=centred(covariance[here.layout.angles, here.layout.angles]),
        halves=np.stack([moved_by(covariance, each.halves, here.layout) for each in said]),
        bias=np.sqrt(sum((moved**2 for moved in assumed), np.zeros_like(here.theta))),
        residuals={name: block.residuals(here.theta) for name, block in blocks.items()},
    )


def honest(said: Said, alone: Fused) -> Said:
    """Return a source made as sure as its halves and its assumptions show it to be.

    Sources overstate themselves differently: features that are pulled alike, a map that cannot
    hold all projections. `alone` is what the source says without the others.
    """
    formal = rms(np.sqrt(np.diag(alone.covariance)))
    excess = max(1.0, rms(alone.sigma) / formal) if formal > 0 else 1.0
    weaker = Quadratic(said.quadratic.information / excess**2, said.quadratic.pull / excess**2)
    return replace(
        said, quadratic=weaker, halves=said.halves / excess**2, biases=said.biases / excess**2
    )


def solver_with(graph: FactorGraph, recorded: Geometry, measurements: AngleMeasurements) -> Solve:
    """Return what tells a source, linearised somewhere, which change (k,) the graph wants.

    The change is NaN where the source does not speak in numbers, or not in numbers that can be
    solved for.
    """

    def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:
        nothing = np.full(len(quadratic.pull), np.nan)
        if not np.isfinite(quadratic.information).all():
            return nothing
        wanted = graph.joint(recorded, measurements, geometry, [quadratic])
        try:
            return change_of(wanted)
        except RuntimeError:  # how gtsam says that a system is indeterminate
            return nothing

    return solve


def moved_by(covariance: Floats, pull: Floats, layout: Layout) -> Floats:
    """(n,) radians: how a pull (k,) moves the angles, the common angle taken out."""
    # The graph does not hear it either: the factor that holds the first angle would answer.
    heard = pull.copy()
    heard[layout.angles] -= pull[layout.angles].mean()
    moved = covariance[layout.angles] @ heard
    return np.asarray(moved - moved.mean())


def centred(covariance: Floats) -> Floats:
    """(n, n) covariance of the angles after their mean was taken off."""
    rows = covariance - covariance.mean(axis=0)
    return np.asarray(rows - rows.mean(axis=1, keepdims=True))


def agree(first: Fused, second: Fused, tolerance: float) -> bool:
    """Say whether two solutions tell the same angles within `tolerance` times their joint sigma."""
    apart = rms_difference(first.geometry.theta, second.geometry.theta)
    return apart <= tolerance * float(np.hypot(rms(first.sigma), rms(second.sigma)))
