"""The paper's section 5.2: how much a graph of encoder and CV factors gains, by simulation.

The graph is linear, and so are its errors in the noise: with the information matrix
``N = sum(J' J / sigma^2)`` of all factors the error of its angles is ``N^-1 sum(J' noise / sigma)``
(noise in units of sigma). N depends on the two standard deviations and not on the draw. So it is
factorised once for each cell, and the factor is shared by all draws, which are columns of one
right-hand side; ``J' noise`` of unit noise is shared by all cells of a step. A cell of 500 graphs
of 360 angles takes some hundredths of a second. A test holds these errors against what the graph of
the pipeline finds, one draw after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats


class Sigmas(NamedTuple):
    """Standard deviations, degrees, of the errors of a step."""

    cv: float
    encoder: float


class Ratios(NamedTuple):
    """Equation 7 over all draws; RMSE in degrees."""

    of_means: float
    """Mean RMSE of the stepper over mean RMSE of the graph."""
    mean: float
    """Mean over the draws of the ratio of both."""
    stepper: float
    """Mean RMSE of the stepper."""
    graph: float
    """Mean RMSE of the graph."""


class Cell(NamedTuple):
    """One set of parameters."""

    reading: str
    """Key of `READINGS`."""
    step_deg: float
    """Of the CV factors, degrees."""
    sigmas: Sigmas


Grid: TypeAlias = Mapping[Cell, Ratios]


def walk(unit: Floats) -> Floats:
    """(n, d) errors of angles whose steps are wrong, which adds up: the first is exact."""
    return np.asarray(np.cumsum(unit, axis=0) - unit[0])


def independent(unit: Floats) -> Floats:
    """(n, d) errors of angles that are wrong each by itself: "to every angle", literally."""
    return unit


READINGS: Mapping[str, Callable[[Floats], Floats]] = {"walk": walk, "independent": independent}
"""How "adding noise to every angle" is read: (n, d) unit noise -> errors of the angles."""


@dataclass(frozen=True)
class Graphs:
    """Graphs of one step size, with the same unit noise for all standard deviations.

    Encoder factors join neighbours, CV factors all pairs of angles the step apart (the paper's
    Figure 3); the end of the turn is not tied to its beginning. The first angle is held where the
    stepper has it, and errors are counted from the truth.
    """

    angles: int
    """Number of angles n, evenly over the turn."""
    step_deg: float
    """Of the CV factors, degrees."""
    draws: int
    """Number of draws d."""
    seed: int
    """Of the noise."""
    reading: str
    """Key of `READINGS`."""

    @property
    def away(self) -> int:
        """Places between the ends of a CV factor."""
        return max(round(self.step_deg * self.angles / 360), 1)

    @cached_property
    def stepper(self) -> Floats:
        """(n, d) errors of the stepper's angles, in its standard deviations."""
        random = np.random.default_rng([self.seed, 0])
        return READINGS[self.reading](random.normal(size=(self.angles, self.draws)))

    @cached_property
    def cv(self) -> Floats:
        """(m, d) errors of the CV steps, in their standard deviations."""
        random = np.random.default_rng([self.seed, 1])
        return random.normal(size=(self.angles - self.away, self.draws))

    @cached_property
    def parts(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Encoder and CV at unit noise: information (n - 1, n - 1) and pull (n - 1, d) of each."""
        encoder, cv = differences(self.angles, 1), differences(self.angles, self.away)
        noise = np.diff(self.stepper, axis=0)
        return encoder.T @ encoder, encoder.T @ noise, cv.T @ cv, cv.T @ self.cv

    def errors(self, sigmas: Sigmas, believed: Sigmas | None = None) -> Floats:
        """(n, d) degrees: errors of the angles of all graphs; the weights are those `believed`."""
        from scipy.linalg import cho_factor, cho_solve

        cv, encoder = believed or sigmas
        stage, stage_pull, seen, seen_pull = self.parts
        factor = cho_factor(stage / encoder**2 + seen / cv**2)
        right = stage_pull * (sigmas.encoder / encoder**2) + seen_pull * (sigmas.cv / cv**2)
        first = self.stepper[:1] * sigmas.encoder
        return np.concatenate([first, first + cho_solve(factor, right)])

    def rmse_of_stepper(self, sigma: float) -> Floats:
        """(d,) degrees: RMSE of all steppers of this standard deviation."""
        return rmse(self.stepper * sigma)

    def ratios(self, sigmas: Sigmas) -> Ratios:
        """Compare the stepper with the graph."""
        stepper, graph = self.rmse_of_stepper(sigmas.encoder), rmse(self.errors(sigmas))
        means = float(stepper.mean()), float(graph.mean())
        return Ratios(means[0] / means[1], float((stepper / graph).mean()), *means)


@dataclass(frozen=True)
class SameAccuracy:
    """How much noisier a walking stepper may be, if graphs are to make it as good as another one.

    That other one is alone, and has the published noise. The CV noise is the one with which the
    published ratio comes about.
    """

    sigma_cv_deg: float
    """CV noise, degrees; nan where no noise gives that ratio."""
    informed: float
    """Times noisier, where the graph knows of it."""
    fixed: float
    """Times noisier, where the graph believes in the published noise."""
    curve: Mapping[float, float]
    """Noise of the stepper, degrees -> RMSE of the other one over that of the graph."""


def rmse(errors: Floats) -> Floats:
    """(d,) root of the mean square of each column of `errors` (n, d)."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def differences(angles: int, away: int) -> Floats:
    """(n - away, n - 1) Jacobian of all steps between angles `away` places apart, but the first."""
    matrix = np.eye(angles)[away:] - np.eye(angles)[:-away]
    return matrix[:, 1:]


def crossing(function: Callable[[float], float], aim: float) -> float:
    """Where a monotonic `function` of a positive number is `aim`; nan where it never is."""
    from scipy.optimize import brentq

    low, high = np.log(1e-3), np.log(1e3)

    def off(place: float) -> float:
        return function(float(np.exp(place))) - aim

    if off(low) * off(high) > 0:
        return float("nan")
    return float(np.exp(brentq(off, low, high, xtol=1e-4)))
