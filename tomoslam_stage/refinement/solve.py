"""Solve the factor graph with robust noise models."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.refinement.graph import linear_graph, marginal_sigma, solve_once

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products import Floats
    from tomoslam_stage.refinement.factors import Block


@dataclass(frozen=True)
class Solution:
    """Angles that agree best with all factors."""

    theta: Floats
    """(n,) radians."""
    residuals: Mapping[str, Floats]
    """By name of the factor: radians."""
    scale: Mapping[str, float]
    """By name of the factor: how much larger its residuals are than its noise model says."""
    graph: Any
    """The `gtsam.GaussianFactorGraph` at `theta`, every factor weighted as it was at last."""

    @cached_property
    def sigma(self) -> Floats:
        """(n,) radians, from the marginals; the first angle is the one held.

        Asked for only where it is needed: it takes longer than solving the graph.
        """
        return marginal_sigma(self.graph, len(self.theta))


@method
class Solver:
    """Iteratively reweighted least squares: the graph is linear, only its weights change."""

    rounds: Annotated[int, Field(ge=1)] = 30
    """At most so many rounds of weighing."""
    settled_deg: Annotated[float, Field(gt=0)] = 1e-4
    """Largest change of an angle that counts as none, degrees."""
    rescale: tuple[str, ...] = ("cv",)
    """Factors whose noise model is scaled up to their residuals: they come in excess."""

    def solve(self, blocks: Mapping[str, Block], theta: Floats) -> Solution:
        """Find the angles, starting from `theta` (n,) radians.

        The first round trusts every factor, so that a jump that only the encoder denies is seen
        before anybody is declared an outlier.
        """
        scale = dict.fromkeys(blocks, 1.0)
        weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
        for _ in range(self.rounds):
            change = solve_once(linear_graph(blocks, weights, theta), len(theta))
            theta = theta + change
            blocks, scale = self._rescaled(blocks, scale, theta)
            weights = {name: block.weights(theta) for name, block in blocks.items()}
            if np.abs(change).max() < np.deg2rad(self.settled_deg):
                break
        residuals = {name: block.residuals(theta) for name, block in blocks.items()}
        return Solution(theta, residuals, scale, linear_graph(blocks, weights, theta))

    def _rescaled(
        self, blocks: Mapping[str, Block], scale: Mapping[str, float], theta: Floats
    ) -> tuple[Mapping[str, Block], dict[str, float]]:
        """Widen noise models until the residuals fit them."""
        widened, scales = dict(blocks), dict(scale)
        for name in set(self.rescale) & set(blocks):
            block = blocks[name]
            if len(block.measured) == 0:
                continue
            excess = max(typical(block, theta), 1 / scale[name])
            widened[name] = replace(block, whitening=block.whitening / excess)
            scales[name] = scale[name] * excess
        return widened, scales


def typical(block: Block, theta: Floats) -> float:
    """Return the standard deviation of the whitened residuals, from their median."""
    from scipy.stats import chi2

    dimensions = block.measured.shape[1]
    expected = np.sqrt(chi2.median(dimensions) / dimensions)
    return float(np.median(block.distance(theta)) / expected)
