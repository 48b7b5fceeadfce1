"""Tracks -> AngleMeasurements: both steps of every triplet of projections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import field
from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.angles.plane import Plane, fit_robustly
from tomoslam_stage.angles.ransac import Ransac
from tomoslam_stage.geometry import partners, wrapped
from tomoslam_stage.methods import method
from tomoslam_stage.products import AngleMeasurements, Floats, Integers, Tracks


class NotMeasured(Exception):  # noqa: N818 (a counted value, never an error a user sees)
    """Why a triplet gave no measurement."""


@method
class Triplets:
    """The paper's estimator: RANSAC over pairs of tracks, then total least squares over inliers."""

    steps_deg: tuple[Annotated[float, Field(gt=0, lt=90)], ...] = (4.0, 5.0, 10.0, 20.0)
    """Steps inside the triplets, degrees; triplets of all projections overlap. The paper's 4, 5 and
    10, and 20 where tracks last that long: it sees the curvature of a path four times as well."""
    ransac: Ransac = field(default_factory=Ransac)
    """How tracks that agree are found."""
    fewest_inliers: Annotated[int, Field(ge=4)] = 6
    """Tracks that must agree."""
    inlier_share: Annotated[float, Field(ge=0, le=1)] = 0.3
    """Share of the triplet's tracks that must agree."""
    closed_form: bool = False
    """Whether steps come from the paper's closed form, or linearised about the expected steps."""
    largest_sigma_deg: Annotated[float, Field(gt=0)] = 1.0
    """A triplet that tells no combination of its steps better than this is near-degenerate."""
    largest_change_deg: Annotated[float, Field(gt=0)] = 3.0
    """Steps further from the expected ones are not believed."""

    def measure(self, tracks: Tracks, theta: Floats, axis: float) -> AngleMeasurements:
        """Measure both steps of each triplet that some tracks run through.

        Parameters
        ----------
        tracks
            The sightings.
        theta
            (n,) radians: the expected angles, recorded or better ones. They give the steps their
            sign and their turn, and are where the measurement is linearised.
        axis
            Detector column of the rotation axis, px; an error of some px does not matter.
        """
        failures: Counter[str] = Counter()
        rows = []
        for step in self.steps_deg:
            for projections, columns in triplets(tracks, theta, np.deg2rad(step)):
                try:
                    rows.append((projections, *self._one(columns - axis, theta[projections])))
                except NotMeasured as why:
                    failures[str(why)] += 1
        if not rows:
            return nothing(failures)
        triplet, steps, covariance, seen, agreed = map(np.array, zip(*rows, strict=True))
        return AngleMeasurements(triplet, steps, covariance, seen, agreed, dict(failures))

    def _one(self, columns: Floats, expected: Floats) -> tuple[Floats, Floats, int, int]:
        """Return steps (2,), their covariance, tracks and inliers of one triplet.

        The same columns always draw the same random pairs.

        Raises
        ------
        NotMeasured
            If the tracks do not say enough.
        """
        if len(columns) < self.fewest_inliers:
            raise NotMeasured("too few tracks")
        _, inliers = self.ransac.consensus(columns, seed=len(columns))
        if inliers.sum() < self.fewest_inliers:
            raise NotMeasured("too few tracks agree")
        plane, inliers = fit_robustly(columns, inliers)
        if inliers.sum() < max(self.fewest_inliers, self.inlier_share * len(columns)):
            raise NotMeasured("too few tracks agree")
        steps, covariance = self._steps(plane, np.diff(expected))
        return steps, covariance, len(columns), int(inliers.sum())

    def _steps(self, plane: Plane, expected: Floats) -> tuple[Floats, Floats]:
        """Return signed and unwrapped steps (2,), branched like `expected`, and their covariance.

        Raises
        ------
        NotMeasured
            If the plane is that of no triangle, an unsure one, or one far from the expected steps.
        """
        turned = wrapped(expected)
        if turned[0] * turned[1] <= 0 or abs(turned.sum()) >= np.pi:
            raise NotMeasured("steps out of order")
        size, covariance = plane.steps() if self.closed_form else plane.steps_near(np.abs(turned))
        if not np.all(np.isfinite(size)) or (self.closed_form and not plane.alternates):
            raise NotMeasured("no such triangle")
        # What counts is the combination of both steps that the features tell best.
        variances, axes = np.linalg.eigh(covariance)
        change = size * np.sign(turned) - turned
        if variances[0] > np.deg2rad(self.largest_sigma_deg) ** 2:
            raise NotMeasured("near-degenerate")
        if np.abs(axes[:, 0] @ change) > np.deg2rad(self.largest_change_deg):
            raise NotMeasured("far from the expected steps")
        return expected + change, covariance


def triplets(tracks: Tracks, theta: Floats, step: float) -> Iterator[tuple[Integers, Floats]]:
    """Yield the projections (3,) of each triplet and the columns (t, 3) of its tracks.

    The projections lie `step` radians apart, as nearly as there are any.
    """
    further = partners(theta, step)
    second = sightings_in(tracks, further)
    third = np.where(second >= 0, second[second], -1)
    complete = np.flatnonzero(third >= 0)
    seen = np.stack([complete, second[complete], third[complete]], axis=1)
    first = tracks.projection[complete]
    by_first = np.argsort(first, kind="stable")
    starts = np.flatnonzero(np.diff(first[by_first])) + 1
    for part in np.split(seen[by_first], starts):
        if len(part):
            yield tracks.projection[part[0]], tracks.column[part]


def sightings_in(tracks: Tracks, partner: Integers) -> Integers:
    """(s,) for each sighting that of the same feature in the `partner` (n,) projection, or -1."""
    if tracks.n_sightings == 0:
        return np.empty(0, np.intp)
    n = len(partner)
    place = tracks.feature * n + tracks.projection
    order = np.argsort(place, kind="stable")
    there = partner[tracks.projection]
    wanted = np.where(there >= 0, tracks.feature * n + there, -1)
    found = np.searchsorted(place, wanted, sorter=order).clip(max=len(order) - 1)
    return np.asarray(np.where(place[order[found]] == wanted, order[found], -1))


def nothing(failures: Counter[str]) -> AngleMeasurements:
    """Return measurements of no triplet at all."""
    none = np.empty(0, np.intp)
    empty = np.empty((0, 3), np.intp), np.empty((0, 2)), np.empty((0, 2, 2))
    return AngleMeasurements(*empty, none, none, dict(failures))
