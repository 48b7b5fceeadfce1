"""Guided growth of tracks: every feature is looked for in every projection.

Once it is known where a feature lies and where the projections look from, it is known where it
must appear in each projection. What is found there belongs to the feature, whoever had followed it
so far; so tracks that broke are joined, and go round the far side of the turn.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.parallel import parallel
from tomoslam_stage.products import Features
from tomoslam_stage.tracks.merging import Candidates, Merging

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Geometry, Integers, Tracks
    from tomoslam_stage.tracks.table import KeypointTable

DESCRIPTOR_SIGMA, ROW_SIGMA_PX = 0.35, 0.5
"""What two sightings of a feature usually differ by."""
NEIGHBOURS = 6
"""At most so many keypoints near where a feature should appear are weighed."""


@dataclass(frozen=True)
class Expected:
    """Features that should appear in one projection, and where."""

    feature: Integers
    """(e,) number of the feature."""
    column: Floats
    """(e,) detector column, px."""
    row: Floats
    """(e,) detector row, px."""
    sigma: Floats
    """(e,) px: how sure the column is."""

    def chosen(self, which: Integers) -> Expected:
        """Return those with the given numbers."""
        return Expected(self.feature[which], self.column[which], self.row[which], self.sigma[which])


@dataclass(frozen=True)
class Known:
    """Everything that is known when features are looked for."""

    table: KeypointTable
    """The keypoints to choose from."""
    tracks: Tracks
    """The sightings so far; its feature numbers run from 0 without gaps."""
    features: Features
    """Where the features lie."""
    geometry: Geometry
    """Where the projections look from."""

    @cached_property
    def size(self) -> Floats:
        """(f,) mean logarithm of the sizes of a feature's keypoints, px."""
        counts = np.bincount(self.tracks.feature, minlength=len(self.features))
        size = np.log(self.table.size[self.tracks.keypoint])
        return np.asarray(
            np.bincount(self.tracks.feature, size, len(self.features)) / np.maximum(counts, 1)
        )

    @cached_property
    def views(self) -> Views:
        """The sightings by feature and direction."""
        return Views.of(self.tracks, self.geometry.theta)

    def expected(self, projection: int, inflation: float) -> Expected:
        """Where all features should appear in a projection."""
        g, features = self.geometry, self.features
        angle = g.theta[projection]
        direction = np.array([np.cos(angle), np.sin(angle)])
        variance = np.einsum("i,fij,j->f", direction, features.covariance, direction)
        column = features.position @ direction + g.origin(features.row, projection)
        row = features.row - g.roll * (column - g.axis - g.shift[projection])
        sigma = inflation * np.sqrt(variance)
        return Expected(np.arange(len(features)), column, row, sigma)


@dataclass(frozen=True)
class Views:
    """The sightings of each feature in the order of their directions, modulo half a turn."""

    number: Integers
    """(s,) sighting, sorted by feature and direction."""
    key: Floats
    """(s,) feature and direction in one number."""
    direction: Floats
    """(s,) radians, in [0, pi)."""
    angle: Floats
    """(s,) radians, whole."""
    first: Integers
    """(f + 1,) first sighting of each feature, and how many there are."""

    @classmethod
    def of(cls, tracks: Tracks, theta: Floats) -> Views:
        """Sort the sightings of `tracks`, whose features are numbered without gaps."""
        angle = theta[tracks.projection]
        direction = np.mod(angle, np.pi)
        order = np.lexsort((direction, tracks.feature))
        feature = tracks.feature[order]
        first = np.searchsorted(feature, np.arange(feature.max(initial=-1) + 2))
        key = cls._key(feature, direction[order])
        return cls(order, key, direction[order], angle[order], first)

    @staticmethod
    def _key(feature: Integers, direction: Floats) -> Floats:
        return np.asarray(4.0 * feature + direction)

    def nearest(self, feature: Integers, angle: float) -> tuple[Integers, NDArray[np.bool_]]:
        """(m,) the sighting from the nearest direction, and whether it is from the far side."""
        wanted = np.mod(angle, np.pi)
        at = np.searchsorted(self.key, self._key(feature, wanted))
        first, end = self.first[feature], self.first[feature + 1]
        # The nearest direction is the next or the one before, around the half turn.
        either = np.stack([np.where(at < end, at, first), np.where(at > first, at, end) - 1])
        gap = np.abs(self.direction[either] - wanted)
        nearer = np.argmin(np.minimum(gap, np.pi - gap), axis=0)
        best = either[nearer, np.arange(len(feature))]
        return self.number[best], np.cos(self.angle[best] - angle) < 0


@method
class Growing:
    """Looks for every feature in every projection, and gives each keypoint to one feature.

    A feature's sightings are all chosen anew: outliers of its track do not come back. On the far
    side of the turn features appear in the mirror, and so do their descriptors.
    """

    most_sigma: Annotated[float, Field(gt=0)] = 0.7
    """px: features are looked for where their column is known better than this."""
    slack: Annotated[float, Field(ge=0)] = 0.75
    """px: how far off the column may be beside three standard deviations."""
    row_tolerance: Annotated[float, Field(gt=0)] = 1.5
    """Largest difference from the expected row, px."""
    distance: Annotated[float, Field(gt=0, le=2)] = 0.9
    """Largest distance of descriptors, from the sighting nearest in direction."""
    size_ratio: Annotated[float, Field(gt=1)] = 1.6
    """Largest ratio of the sizes."""
    inflation: Annotated[float, Field(ge=1)] = 2.0
    """How much less sure places are than their covariance says: sightings err together."""
    bonus: Annotated[float, Field(ge=0)] = 0.15
    """How much better supported features win a keypoint: per e-fold of their support."""
    fewest: Annotated[int, Field(ge=3)] = 8
    """Features with fewer sightings are dropped."""
    merging: Merging = field(default_factory=Merging)
    """How features at one place become one."""

    def grow(self, known: Known) -> Tracks:
        """Merge, look everywhere, and drop what stays short.

        The new numbers of the features run from 0 in the order of the old ones.
        """
        merged = self._merged(known)

        def found(projection: int) -> tuple[Integers, Integers]:
            return self._found(merged, projection)

        parts = [*parallel(found, range(known.table.n_projections))]
        feature, keypoint = (np.concatenate(column) for column in zip(*parts, strict=True))
        way = np.lexsort((merged.geometry.theta[merged.table.projection[keypoint]], feature))
        grown = merged.table.tracks(feature[way], keypoint[way], known.tracks)
        return numbered(grown.sighted(self.fewest))

    def _merged(self, known: Known) -> Known:
        becomes = self.merging.merged(Candidates(known.features, known.size), self.inflation)
        feature = becomes[known.tracks.feature]
        kept, feature = np.unique(feature, return_inverse=True)
        order = np.argsort(feature, kind="stable")
        tracks = known.tracks.chosen(order)
        tracks = replace(tracks, feature=feature[order])
        return replace(known, tracks=tracks, features=joined(known.features, becomes, kept))

    def _found(self, known: Known, projection: int) -> tuple[Integers, Integers]:
        """(m,) features found in a projection, and the keypoints that show them."""
        expected = known.expected(projection, self.inflation)
        expected = expected.chosen(np.flatnonzero(expected.sigma < self.most_sigma))
        which, keypoint = self._near(known, expected, projection)
        expected = expected.chosen(which)
        best, far = known.views.nearest(expected.feature, known.geometry.theta[projection])
        seen = known.tracks.keypoint[best]
        distance = known.table.distance(keypoint, seen, far)
        possible = np.flatnonzero(distance < self.distance)
        expected, keypoint = expected.chosen(possible), keypoint[possible]
        score = self._misfit(known, expected, keypoint)
        score += (distance[possible] / DESCRIPTOR_SIGMA) ** 2 / 2
        chosen = one_to_one(score, expected.feature, keypoint)
        return expected.feature[chosen], keypoint[chosen]

    def _near(self, known: Known, expected: Expected, projection: int) -> tuple[Integers, Integers]:
        """(m,) which of `expected`, and a keypoint that may show it by place and size."""
        from scipy.spatial import cKDTree

        table = known.table
        here = table.of_projection(projection)
        if len(here) == 0 or len(expected.feature) == 0:
            return np.empty(0, np.intp), np.empty(0, np.intp)
        reach = np.array([3 * self.most_sigma + self.slack, self.row_tolerance])
        tree = cKDTree(np.stack([table.column[here], table.row[here]], axis=1) / reach)
        places = np.stack([expected.column, expected.row], axis=1) / reach
        away, nearest = tree.query(places, k=NEIGHBOURS, p=np.inf, distance_upper_bound=1.0)
        which, rank = np.nonzero(np.isfinite(away))
        keypoint = here[np.asarray(nearest)[which, rank]]
        aside = np.abs(table.column[keypoint] - expected.column[which])
        ratio = np.log(table.size[keypoint]) - known.size[expected.feature[which]]
        near = aside <= 3 * expected.sigma[which] + self.slack
        near &= np.abs(ratio) < np.log(self.size_ratio)
        return which[near], keypoint[near]

    def _misfit(self, known: Known, expected: Expected, keypoint: Integers) -> Floats:
        """(m,) how badly the place of a keypoint suits a feature; less where much supports it."""
        table, features = known.table, known.features
        variance = expected.sigma**2 + features.scatter**2
        misfit = (table.column[keypoint] - expected.column) ** 2 / variance
        misfit += ((table.row[keypoint] - expected.row) / ROW_SIGMA_PX) ** 2
        support = np.maximum(features.support[expected.feature], 1)
        return np.asarray(misfit / 2 - self.bonus * np.log(support))


def one_to_one(score: Floats, feature: Integers, keypoint: Integers) -> Integers:
    """Numbers of the pairs chosen, lowest `score` (m,) first, each feature and keypoint once."""
    order = np.argsort(score, kind="stable")
    chosen = [order[:0]]
    while len(order):
        # A pair that comes first for its feature and for its keypoint has nobody to give way to.
        leading = leads(feature[order]) & leads(keypoint[order])
        best = order[leading]
        chosen.append(best)
        free = ~(among(feature[order], feature[best]) | among(keypoint[order], keypoint[best]))
        order = order[free]
    return np.concatenate(chosen)


def leads(numbers: Integers) -> NDArray[np.bool_]:
    """(m,) whether a number is the first of its kind."""
    first = np.empty(numbers.max() + 1, np.intp)
    # Written last to first, so that the first stays.
    first[numbers[::-1]] = np.arange(len(numbers))[::-1]
    return np.asarray(first[numbers] == np.arange(len(numbers)))


def among(numbers: Integers, some: Integers) -> NDArray[np.bool_]:
    """(m,) whether a number is one of `some`; quicker than sorting, as numbers are small."""
    listed = np.zeros(numbers.max() + 1, np.bool_)
    listed[some] = True
    return np.asarray(listed[numbers])


def joined(features: Features, becomes: Integers, kept: Integers) -> Features:
    """Put the features that `becomes` (f,) says are one together, as those `kept` (g,).

    Places are weighed by their information, as a fit to the sightings of both would do.
    """
    target = np.searchsorted(kept, becomes)
    each = np.linalg.inv(features.covariance)
    information, pull = np.zeros((len(kept), 2, 2)), np.zeros((len(kept), 2))
    np.add.at(information, target, each)
    np.add.at(pull, target, np.einsum("fij,fj->fi", each, features.position))
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    support = np.bincount(target, features.support, len(kept)).astype(np.float64, copy=False)
    row = np.bincount(target, features.support * features.row, len(kept))
    return Features(
        position=np.einsum("fij,fj->fi", covariance, pull),
        covariance=covariance,
        row=row / np.maximum(support, 1e-12),
        support=support,
        scatter=features.scatter,
    )


def numbered(tracks: Tracks) -> Tracks:
    """Give the features new numbers from 0 without gaps, in their order."""
    return replace(tracks, feature=np.unique(tracks.feature, return_inverse=True)[1])
