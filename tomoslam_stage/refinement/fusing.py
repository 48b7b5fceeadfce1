"""Several sources of angle measurements in one graph, and what each of them is worth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import rms, rms_difference, unseen_shifts
from tomoslam_stage.products import Floats, Geometry, Quadratic, Solve
from tomoslam_stage.refinement.joint import without_turn
from tomoslam_stage.refinement.stage_noise import stage_noise

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import AngleMeasurements, Layout, StageNoise
    from tomoslam_stage.refinement.graphing import FactorGraph
    from tomoslam_stage.refinement.joint import Solved

ROUNDS = 20
"""At most so many rounds of weighing; the sources are quadratic, only the weights change."""
SETTLED_DEG = 1e-4
"""A change of all angles that counts as none."""
ASTRAY = 3.0
"""Standard deviations by which another noise of the stage may change the angles."""


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

    def weaker(self, less: float) -> Said:
        """Return the same, told with so many times less information."""
        if less == 1:
            return self
        said = self.quadratic
        return replace(
            self,
            quadratic=Quadratic(said.information / less, said.pull / less),
            halves=self.halves / less,
            biases=self.biases / less,
        )


@dataclass(frozen=True)
class Fused:
    """The angles that all sources used agree on."""

    geometry: Geometry
    variances: Floats
    """(n,) radians squared, of each angle, the common angle taken out."""
    step_variances: Floats
    """(n - 1,) radians squared, of each step."""
    halves: Floats
    """(s, n) radians: for each source how its halves would move the angles, common angle out."""
    bias: Floats
    """(n,) radians: how the assumptions of the sources may have moved the angles."""
    residuals: Mapping[str, Floats]
    """By name of the factor: radians."""
    shift_sigma: Floats | None = None
    """(n,) px: one standard deviation of the shifts, as `sigma` of the angles; None where these
    are known."""

    @property
    def shift(self) -> Floats | None:
        """(n,) px: the shifts of the projections; None where these are known."""
        return self.geometry.shift if "shift" in self.geometry.unknowns else None

    @property
    def formal(self) -> Floats:
        """(n,) radians: one standard deviation, as the sources themselves have it."""
        return np.asarray(np.sqrt(self.variances))

    @property
    def half_error(self) -> float:
        """Radians, rms: the error of the angles as the halves of all sources show it."""
        return together(self.halves)

    @property
    def sigma(self) -> Floats:
        """(n,) radians: one standard deviation, no smaller than halves and assumptions show."""
        return no_surer_than(self.half_error, self.formal, self.bias)


def together(halves: Iterable[Floats]) -> float:
    """Rms of the error that the halves of all sources show."""
    return float(np.sqrt(sum(rms(each) ** 2 for each in halves)))


def no_surer_than(half_error: float, formal: Floats, bias: Floats) -> Floats:
    """(n,) one standard deviation: `formal` (n,), but what halves and assumptions show at least."""
    return np.asarray(np.hypot(excess_of(half_error, formal) * formal, bias))


def excess_of(error: float, formal: Floats) -> float:
    """How much an `error` exceeds the `formal` one (n,); at least 1."""
    said = rms(formal)
    return max(1.0, error / said) if said > 0 else 1.0


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
    layout = here.layout

    def heard(quadratic: Quadratic, change: Floats) -> Quadratic:
        # Nobody sees a turn of all angles; told from beyond one, a source must not speak of it.
        return quadratic.after(without_turn(change, layout))

    told = [heard(each.quadratic, here.since(each.geometry)) for each in said]
    for _ in range(ROUNDS):
        change = graph.joint(recorded, measurements, here, told).change
        here, told = here.moved(change), [heard(quadratic, change) for quadratic in told]
        if np.abs(change[layout.angles]).max() < np.deg2rad(SETTLED_DEG):
            break
    ended = graph.joint(recorded, measurements, here, told)
    blocks = {name: f.block(recorded.theta, measurements) for name, f in graph.factors.items()}
    assumed = [moved_by(ended, pull, layout) for each in said for pull in each.biases]
    halves = [moved_by(ended, each.halves, layout) for each in said]
    covariance = ended.covariance()
    variances, step_variances = uncertain(covariance[layout.angles, layout.angles])
    return Fused(
        geometry=here,
        variances=variances,
        step_variances=step_variances,
        halves=np.stack([moved[layout.angles] for moved in halves]),
        bias=squared_together([moved[layout.angles] for moved in assumed], layout.n),
        residuals={name: block.residuals(here.theta) for name, block in blocks.items()},
        shift_sigma=shift_sigma(covariance, here, halves, assumed)
        if "shift" in here.unknowns
        else None,
    )


def shift_sigma(
    covariance: Floats, here: Geometry, halves: Sequence[Floats], assumed: Sequence[Floats]
) -> Floats:
    """(n,) px: how sure the shifts are, but for what nobody sees of them.

    Parameters
    ----------
    covariance
        (v, v) of what is free, the shifts last.
    here
        Where the projections are.
    halves, assumed
        Changes (k,) that the halves of the sources, and their assumptions, make.
    """
    n, unseen = here.layout.n, unseen_shifts(here.theta)

    def seen(change: Floats) -> Floats:
        shift = change[here.layout.shifts]
        return np.asarray(shift - unseen @ (unseen.T @ shift))

    across = covariance[-n:, -n:] @ unseen
    taken = 2 * across - unseen @ (unseen.T @ across)
    formal = np.sqrt(np.diag(covariance)[-n:] - (taken * unseen).sum(axis=1))
    bias = squared_together([seen(change) for change in assumed], n)
    return no_surer_than(together(seen(change) for change in halves), formal, bias)


def squared_together(changes: Sequence[Floats], n: int) -> Floats:
    """(n,) root of the sum of the squares of independent changes (n,)."""
    return np.asarray(np.sqrt(sum((change**2 for change in changes), np.zeros(n))))


def honest(said: Said, alone: Fused) -> Said:
    """Return a source made as sure as its halves show it to be.

    Sources overstate themselves differently, as features that are pulled alike. What their
    assumptions may do is in their biases: it changes few directions, and is no reason to hear less
    about all others. `alone` is what the source says without the others.
    """
    return said.weaker(excess_of(alone.half_error, alone.formal) ** 2)


def as_one(said: Sequence[Said]) -> list[Said]:
    """Return sources that are misled alike: together no surer than one of them."""
    return [each.weaker(len(said)) for each in said]


def with_stage_noise(
    graph: FactorGraph,
    recorded: Floats,
    solved: Callable[[FactorGraph], Fused],
    stage_steps: Floats | float,
) -> tuple[Fused, StageNoise | None]:
    """Solve a graph with the noise of the stage that the sources show, where they do.

    Parameters
    ----------
    graph
        What the pipeline asks for.
    recorded
        (n,) radians.
    solved
        Solves a graph with everything that was said.
    stage_steps
        (n - 1,) that the stage made from each projection to the next, or one number.
    """
    first, free = solved(graph), solved(graph.doubting())
    noise = stage_noise(recorded, free.geometry.theta - recorded, free.halves, stage_steps)
    joint = solved(graph.informed(noise))
    if agree(first, free, ASTRAY) and agree(first, joint, ASTRAY):
        return joint, noise
    # Far from where they looked the sources no longer say what they seem to.
    return first, None


def solver_with(graph: FactorGraph, recorded: Geometry, measurements: AngleMeasurements) -> Solve:
    """Return what tells a source, linearised somewhere, which change (k,) the graph wants.

    The change is NaN where the source does not speak in numbers, or not in numbers that can be
    solved for.
    """

    def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:
        nothing = np.full(len(quadratic.pull), np.nan)
        if not np.isfinite(quadratic.information).all():
            return nothing
        try:
            return graph.joint(recorded, measurements, geometry, [quadratic]).change
        except np.linalg.LinAlgError:
            return nothing

    return solve


def moved_by(ended: Solved, pull: Floats, layout: Layout) -> Floats:
    """(k,) the change that a pull (k,) makes, the common angle taken out."""
    # The graph does not hear it either: the factor that holds the first angle would answer.
    return without_turn(ended.moved_by(without_turn(pull, layout)), layout)


def uncertain(covariance: Floats) -> tuple[Floats, Floats]:
    """(n,) variances of angles after their mean was taken off, and (n - 1,) of their steps."""
    common, each = covariance.mean(axis=0), np.diag(covariance)
    steps = each[1:] + each[:-1] - 2 * np.diag(covariance, 1)
    return np.asarray(each - 2 * common + common.mean()), np.asarray(steps)


def agree(first: Fused, second: Fused, tolerance: float) -> bool:
    """Say whether two solutions tell the same angles within `tolerance` times their joint sigma."""
    apart = rms_difference(first.geometry.theta, second.geometry.theta)
    return apart <= tolerance * float(np.hypot(rms(first.sigma), rms(second.sigma)))
