"""Geometry, what is known about it, and the refined angles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products.arrays import Floats, Integers

Status: TypeAlias = Literal["accepted", "kept"]


@dataclass(frozen=True)
class Geometry:
    """Where all projections look from; at a row the axis lies at ``axis + roll (row - middle)``.

    Changes of it are vectors (n + 2,): the angles, radians; the axis, px; the roll, radians.
    """

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column of the rotation axis at `middle`, px."""
    roll: float = 0.0
    """Tilt of the axis in the detector plane, radians."""
    middle: float = 0.0
    """Detector row where the axis lies at `axis`, px."""

    def moved(self, change: Floats) -> Geometry:
        """Return the geometry after a `change` (n + 2,)."""
        axis, roll = self.axis + float(change[-2]), self.roll + float(change[-1])
        return Geometry(self.theta + change[:-2], axis, roll, self.middle)

    def since(self, start: Geometry) -> Floats:
        """(n + 2,) the change that led here from `start`."""
        return np.append(self.theta - start.theta, [self.axis - start.axis, self.roll - start.roll])

    def axis_at(self, rows: NDArray[Any]) -> Floats:
        """Detector column of the axis at `rows`, px."""
        return np.asarray(self.axis + self.roll * (rows - self.middle), np.float64)


@dataclass(frozen=True)
class Quadratic:
    """What one source says about all angles, the axis and the roll, near where it looked.

    Up to a constant, the log likelihood of a change d (n + 2,) is
    ``pull . d - d . information . d / 2``.
    """

    information: Floats
    """(n + 2, n + 2) positive semidefinite."""
    pull: Floats
    """(n + 2,) slope at no change."""

    def after(self, change: Floats) -> Quadratic:
        """Return the same, told from where a `change` (n + 2,) leads to."""
        return Quadratic(self.information, self.pull - self.information @ change)


Solve: TypeAlias = Callable[[Geometry, Quadratic], Floats]
"""(n + 2,) the change that everything known together wants, given what one source says."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for or against the refined angles, from data that did not make them."""

    half_error_deg: float
    """Error of the refined angles as two disjoint halves of the tracks show it."""
    recorded_error_deg: float
    """Error of the recorded angles as the refined ones show it, that of the halves taken off."""
    half_measured: float
    """Triplets that the poorer half measured, in units of those that all tracks measured."""
    residual_recorded: float
    """Reprojection residual on unused rows with the recorded angles, rms, line integral units."""
    residual_refined: float
    """The same with the refined angles."""
    residual_gain_sigma: float
    """How consistently the residual falls over rows and parts of the turn, in standard errors."""
    sigma_deg: float = 0.0
    """Sigma of the refined angles, rms, where it allows for all that is known; else 0."""


@dataclass(frozen=True)
class Event:
    """A step of the stage far from what its encoder said, and far outside the encoder's noise."""

    projection: int
    """The first projection after it."""
    size_deg: float
    """Degrees that the stage went farther than recorded."""
    significance: float
    """The size, in standard deviations of a step."""
    kind: str
    """What it looks like: ``lost step``, ``dropped frame``, ``duplicated frame``, ``backlash``."""


@dataclass(frozen=True)
class StageNoise:
    """The usual error of a rotation stage, by what it does to the recorded steps."""

    walk: float
    """Radians a step: errors of steps, which add up along the scan."""
    jitter: float
    """Radians: errors of single angles, which do not."""

    @property
    def step(self) -> float:
        """Radians: standard deviation of a recorded step."""
        return float(np.sqrt(self.walk**2 + 2 * self.jitter**2))


@dataclass(frozen=True)
class Refinement:
    """The refined angles, how sure they are, and whether they stand."""

    recorded: Floats
    """(n,) radians."""
    refined: Floats
    """(n,) radians; what the factor graph found, whether it is accepted or not."""
    sigma: Floats
    """(n,) radians, one standard deviation of `refined`."""
    status: Status
    """``accepted``: `refined` stands; ``kept``: `recorded` stands."""
    reason: str
    """Why, in numbers."""
    axes: Mapping[str, float]
    """``recorded``, ``refined`` and each source: detector column of the axis that suits it, px."""
    evidence: Evidence | None = None
    """What the gate weighed, where it came that far."""
    residuals: Mapping[str, Floats] = field(default_factory=dict)
    """Residuals of the factors by factor name, radians."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Numbers worth reporting: features, sightings, triplets measured and failed."""
    reprojection: Mapping[str, Floats] = field(default_factory=dict)
    """By name of the angles: (n,) rms residual of each projection on `heldout_rows`."""
    heldout_rows: Integers = field(default_factory=lambda: np.empty(0, np.intp))
    """Rows that were kept out of the refinement."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """By name of each source of angle measurements: that it was used, or why it was left out."""
    events: tuple[Event, ...] = ()
    """Lost steps and the like, in order; none where the recorded angles stand."""
    roll: float = 0.0
    """Tilt of the axis in the detector plane as the sources found it, radians."""
    stage_noise: StageNoise | None = None
    """The usual error of the rotation stage, where it was estimated."""
    histograms: Mapping[str, Floats] = field(default_factory=dict)
    """What histograms are drawn of: ``track_lengths`` (f,) sightings of each feature and
    ``sighting_residuals`` (s,) px of the projections they were looked for in, column seen less
    column expected; empty where no features were placed."""

    def __post_init__(self) -> None:
        if not self.recorded.shape == self.refined.shape == self.sigma.shape:
            raise ValueError("recorded, refined and sigma differ in length")

    @property
    def theta(self) -> Floats:
        """(n,) radians: the angles that stand."""
        return self.refined if self.status == "accepted" else self.recorded

    @property
    def axis(self) -> float:
        """Detector column of the axis that goes with the angles that stand, px."""
        return self.axes["refined" if self.status == "accepted" else "recorded"]

    @property
    def change(self) -> Floats:
        """(n,) radians: refined minus recorded."""
        return self.refined - self.recorded
