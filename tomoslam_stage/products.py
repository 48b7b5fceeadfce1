"""The products of the stations, in the order in which a scan passes them.

    Scan -> Tracks -> AngleMeasurements -> Refinement -> Reconstructions -> Comparison

Conventions, kept everywhere:

* projections are indexed (projection, row, column); rows grow downwards, columns to the right,
  pixel centres lie on whole numbers;
* angles are radians, unwrapped; degrees exist in keys and file datasets only, whose names end
  ``_deg``, and inside `scans`;
* ``u = X cos(theta) + Z sin(theta)`` is the column of the point (X, Z), counted from the axis,
  in a parallel beam; a projection's detector column is ``u + axis``;
* a slice is an array (z, x) whose middle ``(n - 1) / 2`` lies on the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pathlib import Path

Floats: TypeAlias = NDArray[np.float64]
Pixels: TypeAlias = NDArray[np.float32]
Integers: TypeAlias = NDArray[np.intp]
Status: TypeAlias = Literal["accepted", "kept"]
Values: TypeAlias = Literal["counts", "transmission", "line_integrals"]


class ProjectionSource(Protocol):
    """Where a scan's line integrals come from: a file, read lazily, or an array."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Projections, rows, columns."""
        ...

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        """Values (projection, row, column), float32, of the chosen projections and rows."""
        ...


class Conversion(Protocol):
    """Makes line integrals of what a detector stored."""

    kind: ClassVar[Values]
    """What it takes."""

    def __call__(self, raw: Pixels, projections: Integers, rows: Integers, /) -> Pixels:
        """Line integrals of `raw` (p, r, c), which may be changed in place."""
        ...


@dataclass(frozen=True)
class Raw:
    """What is needed to make line integrals of projections that are none yet."""

    conversion: Conversion
    """Makes them, where the pipeline does not."""
    flats: ProjectionSource | None = None
    """(f, row, column) the beam without the object, counts."""
    darks: ProjectionSource | None = None
    """(f, row, column) the detector without the beam, counts."""


@dataclass(frozen=True)
class Scan:
    """A scan as it was recorded; its projections are read when they are asked for."""

    source: ProjectionSource
    """Line integrals (but see `raw`), one projection per entry of `theta`."""
    theta: Floats
    """(n,) radians, unwrapped: the recorded angles."""
    frames: Integers
    """(n,) index of each projection in the file."""
    name: str = "scan"
    """What messages call it."""
    path: Path | None = None
    """The file, where there is one."""
    binning: int = 1
    """Detector pixels of the file in one pixel of `source`, along rows and columns."""
    raw: Raw | None = None
    """Where `source` still gives what the detector stored; None once these are line integrals."""

    def __post_init__(self) -> None:
        n = self.source.shape[0]
        if self.theta.shape != (n,) or self.frames.shape != (n,):
            raise ValueError(
                f"{n} projections need {n} angles and {n} frames; "
                f"found {self.theta.shape} and {self.frames.shape}"
            )

    @property
    def values(self) -> Values:
        """What `source` gives."""
        return "line_integrals" if self.raw is None else self.raw.conversion.kind

    @property
    def n_projections(self) -> int:
        """Number of projections."""
        return self.source.shape[0]

    @property
    def n_rows(self) -> int:
        """Number of detector rows."""
        return self.source.shape[1]

    @property
    def n_columns(self) -> int:
        """Number of detector columns."""
        return self.source.shape[2]

    def projection(self, index: int) -> Pixels:
        """(row, column) line integrals of one projection."""
        alone: Pixels = self.source.read(np.array([index]), np.arange(self.n_rows))[0]
        return alone

    def column_in_file(self, column: float) -> float:
        """Return the detector column of the file, px, at the centre of `column` of this scan."""
        return column * self.binning + (self.binning - 1) / 2

    def column_from_file(self, column: float) -> float:
        """Return the column of this scan, px, that lies at detector `column` of the file."""
        return (column - (self.binning - 1) / 2) / self.binning

    def sinograms(self, rows: Integers) -> Pixels:
        """(row, projection, column) line integrals of a few rows."""
        everything = np.arange(self.n_projections)
        return self.source.read(everything, rows).transpose(1, 0, 2)


@dataclass(frozen=True)
class Tracks:
    """The sightings of all features, sorted by feature, then along the way of tracking."""

    feature: Integers
    """(s,) number of the feature that was sighted."""
    projection: Integers
    """(s,) projection it was sighted in."""
    column: Floats
    """(s,) detector column, px."""
    row: Floats
    """(s,) detector row, px."""
    keypoints: Integers
    """(n,) keypoints found in each projection, before any was matched or left out."""
    fixed_to_detector: int = 0
    """Keypoints left out because they do not move while the object does (dust, hot pixels)."""
    keypoint: Integers = field(default_factory=lambda: np.empty(0, np.intp))
    """(s,) number of the keypoint among all moving ones of the scan; empty where none is kept."""
    unlike: Floats = field(default_factory=lambda: np.empty((0, 2)))
    """(s, 2) how little a sighting looks like its track: distance of the descriptors, difference of
    the logarithms of the sizes; empty where nobody looked."""

    def __post_init__(self) -> None:
        columns = [self.feature, self.projection, self.column, self.row]
        columns += [c[:, 0] if c.ndim > 1 else c for c in (self.keypoint, self.unlike) if len(c)]
        shapes = {column.shape for column in columns}
        if len(shapes) != 1:
            raise ValueError(f"the columns of Tracks differ in length: {shapes}")

    @property
    def n_sightings(self) -> int:
        """Number of sightings."""
        return len(self.feature)

    @property
    def n_features(self) -> int:
        """Number of different features."""
        return len(np.unique(self.feature))

    def chosen(self, mask: NDArray[np.bool_] | Integers) -> Tracks:
        """Return the sightings where `mask` (s,) holds, or those with the given numbers."""
        return Tracks(
            self.feature[mask],
            self.projection[mask],
            self.column[mask],
            self.row[mask],
            self.keypoints,
            self.fixed_to_detector,
            self.keypoint[mask] if len(self.keypoint) else self.keypoint,
            self.unlike[mask] if len(self.unlike) else self.unlike,
        )

    def sighted(self, fewest: int) -> Tracks:
        """Return the features with at least so many sightings."""
        counts = np.bincount(self.feature) if self.n_sightings else np.zeros(1, np.intp)
        return self.chosen(counts[self.feature] >= fewest)


@dataclass(frozen=True)
class Features:
    """Where the features of some tracks lie, in the order of their numbers."""

    position: Floats
    """(f, 2) px: X and Z, from the axis."""
    covariance: Floats
    """(f, 2, 2) px squared, of `position` when the geometry is known."""
    row: Floats
    """(f,) detector row where the feature lies when it is on the axis, px."""
    support: Floats
    """(f,) sightings that agree: the sum of their weights, each at most about one."""
    scatter: float
    """px: robust standard deviation of the columns of sightings."""

    def __len__(self) -> int:
        return len(self.row)


@dataclass(frozen=True)
class AngleMeasurements:
    """The steps inside triplets of projections, as the tracks show them."""

    projections: Integers
    """(m, 3) the three projections of each triplet."""
    steps: Floats
    """(m, 2) radians: theta2 - theta1 and theta3 - theta2, unwrapped like the recorded steps."""
    covariance: Floats
    """(m, 2, 2) radians squared."""
    tracks: Integers
    """(m,) tracks seen in all three projections."""
    inliers: Integers
    """(m,) tracks that agree with the measured steps."""
    failures: Mapping[str, int] = field(default_factory=dict)
    """How many triplets gave no measurement, by reason."""

    def __post_init__(self) -> None:
        m = len(self.projections)
        shapes = (self.projections.shape, self.steps.shape, self.covariance.shape)
        if shapes != ((m, 3), (m, 2), (m, 2, 2)):
            raise ValueError(f"the columns of AngleMeasurements have the shapes {shapes}")

    @property
    def n_measured(self) -> int:
        """Number of triplets that were measured."""
        return len(self.projections)

    @classmethod
    def none(cls) -> AngleMeasurements:
        """Return no measurements."""
        number = np.empty(0, np.intp)
        return cls(number.reshape(0, 3), np.empty((0, 2)), np.empty((0, 2, 2)), number, number)


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
    """``recorded`` and ``refined``: detector column of the rotation axis that suits either, px."""
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
    """Lost steps and the like, in order."""
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


@dataclass(frozen=True)
class Reconstruction:
    """Slices reconstructed with one set of angles."""

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column of the axis that was used, px."""
    rows: Integers
    """(r,) detector rows of the slices."""
    slices: Pixels
    """(r, z, x) attenuation per pixel."""
    method: str
    """Backend and algorithm, for instance ``embedded fbp``."""
    convergence: Floats = field(default_factory=lambda: np.empty(0))
    """(iterations,) rms of what is left of the sinograms; empty where nothing iterates."""


Reconstructions: TypeAlias = Mapping[str, Reconstruction]
"""By name: ``recorded``, ``refined`` and, for simulated scans, ``true``; with ``_even`` or ``_odd``
after the name from every other projection alone."""


@dataclass(frozen=True)
class Truth:
    """The true angles of a simulated scan. Only the report may look at them."""

    theta: Floats
    """(n,) radians."""
    axis: float | None = None
    """Detector column, px."""


@dataclass(frozen=True)
class Comparison:
    """Numbers that compare the reconstructions by name, all shown without a verdict."""

    sharpness: Mapping[str, Mapping[str, float]]
    """Metric -> name of the reconstruction -> value."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Against the truth, where the scan is simulated: degrees, and the ratio of equation 7."""
    similarity: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Metric -> name -> value: ``psnr`` (dB) and ``ssim`` against the slices of the true angles."""
    frc_frequency: Floats = field(default_factory=lambda: np.empty(0))
    """(f,) cycles per px."""
    frc_threshold: Floats = field(default_factory=lambda: np.empty(0))
    """(f,) the correlation that the resolution is read off at."""
    frc: Mapping[str, Floats] = field(default_factory=dict)
    """Name -> (f,) correlation of its even with its odd half; empty where there are no halves."""
    frc_resolution_px: Mapping[str, float] = field(default_factory=dict)
    """Name -> px: period at which `frc` first falls below the threshold."""
    edge_width_px: Mapping[str, float] = field(default_factory=dict)
    """Name -> px in which the most changed edge rises from 10 to 90 %; nan where it does not."""
