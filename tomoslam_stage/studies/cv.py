"""The paper's CV estimator at one step size, with its minimal sample and with all inliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.angles.plane import fit_robustly
from tomoslam_stage.angles.ransac import Ransac, steps_of_pair
from tomoslam_stage.angles.triplets import triplets
from tomoslam_stage.geometry import partners, wrapped
from tomoslam_stage.progress import progress
from tomoslam_stage.tracks.detectors import Detector, Keypoints, Sift, Surf
from tomoslam_stage.tracks.following import Follower, Runs, Sights, Steps
from tomoslam_stage.tracks.keypoints import find_keypoints
from tomoslam_stage.tracks.linking import tracks_of
from tomoslam_stage.tracks.tracking import Tracking

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products import Floats, Integers, Tracks
    from tomoslam_stage.studies.case import Case

FEWEST = 6
"""Tracks that must agree, as in the pipelines."""
NORMAL_QUARTILES = 1.349
"""Standard deviations between the quartiles of a normal distribution."""


@dataclass(frozen=True)
class Way:
    """One way to measure the steps of triplets."""

    detector: Detector
    """What finds keypoints."""
    followed: bool = False
    """Features are followed from neighbour to neighbour, not matched a step apart."""
    minimal: bool = False
    """Steps come from the pair of tracks that most others agree with, and not from them all."""

    def follower(self, step: float) -> Follower:
        """How keypoints become tracks for triplets of `step` degrees."""
        return Runs() if self.followed else Steps(steps_deg=(step,))


WAYS: Mapping[str, Way] = {
    "SURF, minimal sample": Way(Surf(), minimal=True),
    "SURF, total least squares": Way(Surf()),
    "SIFT, minimal sample": Way(Sift(), minimal=True),
    "SIFT, total least squares": Way(Sift()),
    "SIFT, followed, total least squares": Way(Sift(), followed=True),
    "SURF of mahotas, minimal sample": Way(Surf(mended=False), minimal=True),
}
"""The first is the paper's. What is followed is seen in every projection between."""
PAPER, OURS = "SURF, minimal sample", "SIFT, followed, total least squares"


@dataclass(frozen=True)
class Measured:
    """Both steps of all triplets of one step size, by one way."""

    step_deg: float
    """The steps that were asked for, degrees."""
    possible: int
    """Triplets that the angles of the scan allow."""
    tracks: Floats
    """(p,) tracks seen in all three projections of each, 0 for those with none."""
    steps: Floats
    """(m, 2) degrees, of those that were measured."""
    errors: Floats
    """(m, 2) degrees, against the angles of reference."""

    @property
    def quartiles(self) -> Floats:
        """(3,) degrees: quartiles and median of the errors of all steps."""
        if not len(self.errors):
            return np.full(3, np.nan)
        return np.asarray(np.percentile(self.errors, [25, 50, 75]))

    @property
    def sigma(self) -> float:
        """Degrees: standard deviation of the normal distribution that has these quartiles."""
        return float((self.quartiles[2] - self.quartiles[0]) / NORMAL_QUARTILES)

    @property
    def typical_tracks(self) -> float:
        """Median number of tracks in a triplet."""
        return float(np.median(self.tracks)) if len(self.tracks) else 0.0

    @property
    def median_error(self) -> float:
        """Standard error of the median, degrees, as if all steps had independent errors."""
        return float(1.2533 * self.sigma / np.sqrt(max(self.errors.size, 1)))

    @property
    def share(self) -> float:
        """Of the possible triplets, those that were measured."""
        return len(self.steps) / max(self.possible, 1)

    def row(self, name: str) -> dict[str, Any]:
        """Plain numbers of this way, for tables."""
        first, median, third = (float(q) for q in self.quartiles)
        return {
            "way": name,
            "step_deg": self.step_deg,
            "triplets_possible": self.possible,
            "triplets_measured": len(self.steps),
            "tracks_per_triplet_median": self.typical_tracks,
            "first_quartile_deg": first,
            "median_deg": median,
            "third_quartile_deg": third,
            "sigma_from_quartiles_deg": self.sigma,
        }


def measured(case: Case, name: str, step: float) -> Measured:
    """Measure the triplets of `step` degrees in the way called `name`."""
    way = WAYS[name]

    def both() -> Mapping[bool, Measured]:
        return estimated(case, tracked(case, way, step), step, name.partition(",")[0])

    # The minimal sample and all inliers come from the same consensus.
    return case.once(("steps", way.detector, way.followed, step), both)[way.minimal]


def moving_keypoints(case: Case, detector: Detector) -> list[Keypoints]:
    """Find the keypoints of every projection, but for those that are fixed to the detector."""

    def found() -> list[Keypoints]:
        tracking = Tracking()
        everything = find_keypoints(case.scan, detector, tracking.background, case.rows.usable)
        fixed = tracking.fixed.find(everything, case.scan.theta)
        return [k.chosen(~mask) for k, mask in zip(everything, fixed, strict=True)]

    return case.once(("keypoints", detector), found)


def tracked(case: Case, way: Way, step: float) -> Tracks:
    """Match the keypoints of `way` for triplets of `step` degrees."""

    def found() -> Tracks:
        keypoints = moving_keypoints(case, way.detector)
        sights = Sights(keypoints, case.scan.theta, case.axis, Tracking().matching)
        return tracks_of(way.follower(step).runs(sights), keypoints, 0)

    return case.once(("tracks", way.detector, way.follower(step)), found)


def estimated(case: Case, tracks: Tracks, step: float, what: str) -> dict[bool, Measured]:
    """Measure all triplets: from the minimal sample (True) and from all inliers (False)."""
    radians, theta = np.deg2rad(step), case.scan.theta
    further = partners(theta, radians)
    possible = int(((further >= 0) & (further[further] >= 0)).sum())
    found: dict[bool, list[Floats]] = {True: [], False: []}
    projections: list[Integers] = []
    counts = np.zeros(possible)
    asked = progress(triplets(tracks, theta, radians), f"{what}, {step:g} degrees", possible)
    for number, (triplet, columns) in enumerate(asked):
        counts[number] = len(columns)
        for minimal, steps in zip((True, False), steps_of(columns - case.axis), strict=True):
            found[minimal].append(steps)
        projections.append(triplet)
    return {
        minimal: judged(
            case, np.array(projections, np.intp), np.array(steps), (step, possible, counts)
        )
        for minimal, steps in found.items()
    }


def steps_of(columns: Floats) -> tuple[Floats, Floats]:
    """(2,) radians, unsigned: both steps by the minimal sample, and by all inliers; else NaN."""
    nothing = np.full(2, np.nan)
    if len(columns) < FEWEST:
        return nothing, nothing
    pair, inliers = Ransac().consensus(columns, seed=len(columns))
    if inliers.sum() < FEWEST:
        return nothing, nothing
    one, other = columns[pair]
    plane, _ = fit_robustly(columns, inliers)
    both = plane.steps()[0] if plane.alternates else nothing
    return steps_of_pair(one, other), both


def judged(
    case: Case, projections: Integers, steps: Floats, asked: tuple[float, int, Floats]
) -> Measured:
    """Hold `steps` (m, 2), radians, NaN where there are none, against the angles of reference."""
    step, possible, counts = asked
    steps = steps.reshape(-1, 2)
    measured = np.isfinite(steps).all(axis=1)
    triplet = projections.reshape(-1, 3)[measured]
    # Steps come without their sign, and round the end of a full turn.
    sign = np.sign(wrapped(np.diff(case.scan.theta[triplet], axis=1)))
    true = wrapped(np.diff(case.reference[triplet], axis=1)) * sign
    size = np.rad2deg(steps[measured])
    return Measured(step, possible, counts, size, size - np.rad2deg(true))
