"""What features show: tracks, places, and the steps inside triplets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products.arrays import Floats, Integers


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
class Closures:
    """Projections that see again, half a turn or a full turn on, what others saw."""

    projections: Integers
    """(m, 3) a projection, the one before that it resembles most, and that one's neighbour."""
    share: Floats
    """(m,) of the way from the second to the third at which the first lies."""
    turn: Floats
    """(m,) radians: whole half turns between them."""
    sigma: Floats
    """(m,) radians."""

    def __post_init__(self) -> None:
        m = len(self.projections)
        shapes = (self.projections.shape, self.share.shape, self.turn.shape, self.sigma.shape)
        if shapes != ((m, 3), (m,), (m,), (m,)):
            raise ValueError(f"the columns of Closures have the shapes {shapes}")

    def __len__(self) -> int:
        return len(self.share)

    @classmethod
    def none(cls) -> Closures:
        """Return no closures."""
        return cls(np.empty((0, 3), np.intp), np.empty(0), np.empty(0), np.empty(0))


@dataclass(frozen=True)
class AngleMeasurements:
    """What is known between single projections: steps inside triplets, closures, the stage's way.

    The recorded angles are not in here.
    """

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
    closures: Closures = field(default_factory=Closures.none)
    """Where loops close."""
    stage_steps: Floats | float = 1.0
    """(n - 1,) steps that the stage made from each projection to the next, see `Scan`; or one
    number where these are alike."""

    def __post_init__(self) -> None:
        m = len(self.projections)
        shapes = (self.projections.shape, self.steps.shape, self.covariance.shape)
        if shapes != ((m, 3), (m, 2), (m, 2, 2)):
            raise ValueError(f"the columns of AngleMeasurements have the shapes {shapes}")

    @property
    def n_measured(self) -> int:
        """Number of triplets that were measured."""
        return len(self.projections)

    def joined(self, triplets: AngleMeasurements) -> AngleMeasurements:
        """Return `triplets` with the rest of what is known here."""
        return replace(triplets, closures=self.closures, stage_steps=self.stage_steps)

    @classmethod
    def none(cls) -> AngleMeasurements:
        """Return no measurements."""
        number = np.empty(0, np.intp)
        return cls(number.reshape(0, 3), np.empty((0, 2)), np.empty((0, 2, 2)), number, number)
