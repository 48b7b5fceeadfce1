"""The station AngleMeasurements -> angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.methods import FromTable, checked, method
from tomoslam_stage.products import AngleMeasurements, Floats, Geometry, Quadratic, StageNoise
from tomoslam_stage.refinement.factors import FACTORS, Encoder, Factor
from tomoslam_stage.refinement.gate import Gate
from tomoslam_stage.refinement.graph import linear_graph
from tomoslam_stage.refinement.joint import Joint, Solved
from tomoslam_stage.refinement.solve import Solution, Solver

DOUBTED_DEG, HELD = 1.0, 1e6
"""Standard deviation of a step, degrees, that lets the other sources speak alone; never robust."""
INDISPENSABLE = ("prior", "encoder")
"""Factors that reach every angle, whatever was measured."""


def factors_from(spec: Any) -> Any:
    """Make each factor that a mapping of names to parameters asks for.

    Raises
    ------
    PipelineError
        For an unknown factor or parameter, and where the graph would have no single solution.
    """
    if not isinstance(spec, Mapping):
        return spec
    for name in spec:
        if name not in FACTORS:
            remedy = nearest(str(name), FACTORS)
            raise PipelineError("refinement.factors", f"no factor {name!r}.", remedy)
    for name in INDISPENSABLE:
        if name not in spec:
            found = f"the factor {name!r} is missing; without it some angle is held by nothing."
            raise PipelineError("refinement.factors", found, f"Add '{name}: {{}}'.")
    return {
        name: checked(FACTORS[name], given or {}, f"refinement.factors.{name}")
        if given is None or isinstance(given, Mapping)
        else given
        for name, given in spec.items()
    }


@method
class FactorGraph:
    """The paper's section 4: factors on the angles, solved together, and the gate behind them."""

    factors: Annotated[Mapping[str, Factor], FromTable(factors_from, table=FACTORS, every=True)] = (
        field(default_factory=lambda: {name: factor() for name, factor in FACTORS.items()})
    )
    """Which factors are in the graph, by name, with their noise models."""
    shift_px: Annotated[float, Field(gt=0)] = 1.0
    """Standard deviation of the shift of a projection, px (binned ones, where a wide scan is
    binned), where shifts are unknown."""
    solver: Solver = field(default_factory=Solver)
    """How it is solved."""
    gate: Gate = field(default_factory=Gate)
    """What the angles must show before they stand."""

    def solve(self, theta: Floats, measurements: AngleMeasurements) -> Solution:
        """Find the angles that agree best with the recorded `theta` (n,) and `measurements`."""
        blocks = {name: f.block(theta, measurements) for name, f in self.factors.items()}
        return self.solver.solve(blocks, theta)

    def joint(
        self,
        recorded: Geometry,
        measurements: AngleMeasurements,
        here: Geometry,
        quadratics: Sequence[Quadratic],
    ) -> Solved:
        """Solve, around `here`, for all factors and for sources tied to all angles.

        Raises
        ------
        LinAlgError
            If something is held by nothing.
        """
        joint, single = Joint.of(here.layout), {}
        for name, factor in self.factors.items():
            if isinstance(factor, Encoder) and factor.noise.jitter:
                joint.hear_chain(*factor.chain(recorded.theta, here.theta, measurements))
            else:
                single[name] = factor.block(recorded.theta, measurements)
        weights = {name: block.weights(here.theta) for name, block in single.items()}
        joint.hear_graph(linear_graph(single, weights, here.theta))
        joint.hold(recorded.since(here), self.shift_px)
        for quadratic in quadratics:
            joint.hear(quadratic)
        return joint.solved()

    def informed(self, noise: StageNoise) -> FactorGraph:
        """Return the same with an encoder factor of this noise, where a pipeline gives no other."""
        encoder = self.factors["encoder"]
        if not isinstance(encoder, Encoder):
            return self
        known = {"sigma_deg": noise.walk, "jitter_deg": noise.jitter}
        estimated = {
            name: float(np.degrees(sigma))
            for name, sigma in known.items()
            if getattr(encoder, name) is None
        }
        return replace(self, factors={**self.factors, "encoder": replace(encoder, **estimated)})

    def doubting(self) -> FactorGraph:
        """Return the same with an encoder factor that says next to nothing."""
        factors = {**self.factors, "encoder": Encoder(sigma_deg=DOUBTED_DEG, robust=HELD)}
        return replace(self, factors=factors)
