"""The refined angles, and what speaks for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tomoslam_stage.products.arrays import Floats, Integers
from tomoslam_stage.products.geometry import STILL, Unknown
from tomoslam_stage.products.notebook import as_html

Status: TypeAlias = Literal["accepted", "kept"]


@dataclass(frozen=True)
class Rigidity:
    """What the rows of features say about the sample and the beam; they made no angle."""

    features: int
    """Features that were asked."""
    moved_px: float
    """px of the file, rms: how far rows move as the scan goes on, that of noise taken off."""
    moved_significance: float
    """By how many standard errors that is more than noise."""
    cone_px: float
    """px of the file: how far rows move, top and bottom apart, from the axis to the greatest depth;
    0 in a parallel beam."""
    cone_significance: float
    """The same in standard errors."""
    pixel: int = 1
    """px of the file that a px spanned in which features were found."""


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
    rigidity: Rigidity | None = None
    """What the rows of features say, where there are enough of them."""


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
        return float(np.sqrt(self.variance_after(1.0)))

    def variance_after(self, steps: Floats | float) -> Floats | float:
        """Radians squared: variance of a recorded difference of so many `steps`."""
        return self.walk**2 * steps + 2 * self.jitter**2


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

    unknowns: tuple[Unknown, ...] = STILL
    """What the sources solved for, where there were any."""
    shift: Floats | None = None
    """(n,) px that each projection lies to the right, where `refined` stands; None where the sample
    was taken to stand still."""
    shift_sigma: Floats | None = None
    """(n,) px, one standard deviation of `shift`, but for what nobody sees of it: the axis, and a
    place of the whole sample; None where there is no `shift`."""

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

    def _told(self) -> dict[str, str]:
        """Say in words what a reader asks first."""
        change, sigma = np.degrees(self.change), np.degrees(self.sigma[np.isfinite(self.sigma)])
        told = {
            "status": self.status,
            "why": self.reason,
            "projections": str(len(change)),
            "correction": f"{np.std(change):.3g} degrees rms, {np.ptp(change):.3g} from end to end",
            "sigma": f"{np.sqrt(np.mean(sigma**2)):.3g} degrees" if len(sigma) else "unknown",
            "axis": f"{self.axis:.2f} px",
        }
        if self.shift is not None:
            told["shifts"] = f"{np.std(self.shift):.3g} px rms"
        for event in self.events:
            told[f"{event.kind} at {event.projection}"] = f"{event.size_deg:.3g} degrees"
        return told

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return as_html(self._told(), np.degrees(self.change), np.degrees(self.sigma))
