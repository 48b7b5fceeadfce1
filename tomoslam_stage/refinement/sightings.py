"""Sightings of features as columns of equations, features numbered without gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.products import Features

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Geometry, Integers, Tracks

SLIGHT = 1e-6
"""px^-2: information that holds what the sightings of a feature leave open."""


@dataclass(frozen=True)
class Sightings:
    """The sightings of `Tracks`, sorted by feature, then by angle."""

    feature: Integers
    """(s,) from 0 without gaps."""
    projection: Integers
    """(s,) projection it was sighted in."""
    column: Floats
    """(s,) detector column, px."""
    row: Floats
    """(s,) detector row, px."""
    unlike: Floats
    """(s, c) see `Tracks`; c is 0 where nobody looked."""
    order: Integers
    """(s,) number of each sighting in the tracks."""
    counts: Integers
    """(f,) sightings of each feature."""

    @classmethod
    def of(cls, tracks: Tracks, theta: Floats) -> Sightings:
        """Sort the sightings of `tracks`, whose projections lie at `theta` (n,) radians."""
        feature = np.unique(tracks.feature, return_inverse=True)[1]
        order = np.lexsort((theta[tracks.projection], feature))
        unlike = tracks.unlike if len(tracks.unlike) else np.empty((tracks.n_sightings, 0))
        return cls(
            feature=feature[order],
            projection=tracks.projection[order],
            column=tracks.column[order],
            row=tracks.row[order],
            unlike=unlike[order],
            order=order,
            counts=np.bincount(feature),
        )

    @property
    def n_features(self) -> int:
        """Number of features."""
        return len(self.counts)

    def sums(self, values: Floats) -> Floats:
        """(f,) sum of `values` (s,) over the sightings of each feature."""
        return np.bincount(self.feature, values, self.n_features).astype(np.float64, copy=False)

    def means(self, values: Floats, weights: Floats) -> Floats:
        """(f,) weighted mean of `values` (s,) over the sightings of each feature."""
        return self.sums(weights * values) / np.maximum(self.sums(weights), 1e-12)

    def directions(self, geometry: Geometry) -> Floats:
        """(s, 2) cosine and sine of the angle of each sighting."""
        each = np.stack([np.cos(geometry.theta), np.sin(geometry.theta)], axis=1)
        return np.asarray(each[self.projection])

    def residuals(self, geometry: Geometry, position: Floats) -> Floats:
        """(s,) px: columns sighted, less those where features at `position` (f, 2) must appear."""
        expected = np.einsum("si,si->s", self.directions(geometry), position[self.feature])
        return np.asarray(self.column - expected - geometry.origin(self.row, self.projection))

    def covariances(self, directions: Floats, weights: Floats) -> Floats:
        """(f, 2, 2) px squared: of the features, for `weights` (s,) px^-2 and a known geometry."""
        cosine, sine = directions.T
        first = self.sums(weights * cosine**2) + SLIGHT
        mixed = self.sums(weights * cosine * sine)
        second = self.sums(weights * sine**2) + SLIGHT
        adjugate = np.stack([second, -mixed, -mixed, first], axis=1).reshape(-1, 2, 2)
        return np.asarray(adjugate / (first * second - mixed**2)[:, None, None])

    def positions(self, geometry: Geometry, weights: Floats) -> Floats:
        """(f, 2) px from the axis: where the features lie, for `weights` (s,) px^-2."""
        directions = self.directions(geometry)
        column = weights * (self.column - geometry.origin(self.row, self.projection))
        pull = np.stack([self.sums(column * part) for part in directions.T], axis=1)
        covariances = self.covariances(directions, weights)
        return np.asarray(np.einsum("fij,fj->fi", covariances, pull))

    def features(
        self, geometry: Geometry, position: Floats, noise: tuple[Floats, float]
    ) -> Features:
        """Describe the features at `position` (f, 2) px.

        `noise` is the weights (s,) px^-2 of the sightings, and the scale of their residuals, px.
        """
        weights, scale = noise
        # An axis that leans moves rows, too: v = Y - roll u.
        level = geometry.level(self.column, self.row, self.projection)
        return Features(
            position=position,
            covariance=self.covariances(self.directions(geometry), weights),
            row=self.means(level, weights),
            support=self.sums(weights * scale**2),
            scatter=scale,
        )
