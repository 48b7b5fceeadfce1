"""From keypoints to tracks: the sightings of one feature along the turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Protocol, runtime_checkable

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import wrapped
from tomoslam_stage.methods import method
from tomoslam_stage.parallel import parallel
from tomoslam_stage.tracks.linking import Links, a_step_apart, neighbours

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tomoslam_stage.products import Floats, Integers
    from tomoslam_stage.tracks.detectors import Keypoints
    from tomoslam_stage.tracks.matching import Matching


@dataclass(frozen=True)
class Sights:
    """Everything that following features needs to know."""

    keypoints: Sequence[Keypoints]
    """(n,) of each projection."""
    theta: Floats
    """(n,) radians: the recorded angles."""
    axis: float
    """Detector column of the rotation axis, px."""
    matching: Matching
    """How two projections are matched."""

    @property
    def first(self) -> Integers:
        """(n + 1,) number of the first keypoint of each projection, and of all keypoints."""
        return np.concatenate([[0], np.cumsum([len(k) for k in self.keypoints])])

    def matched(self, links: Integers, what: str) -> Integers:
        """(p, 2) numbers of matching keypoints in the linked projections (l, 2)."""
        first = self.first

        def pairs(link: Integers) -> Integers:
            here, there = link
            step = float(wrapped(self.theta[there] - self.theta[here]))
            one, other = self.keypoints[here], self.keypoints[there]
            return self.matching.pairs(one, other, step, self.axis) + first[link]

        return np.concatenate([np.empty((0, 2), np.intp), *parallel(pairs, list(links), what)])


@runtime_checkable
class Follower(Protocol):
    """Links matching keypoints into runs, each the sightings of one feature."""

    def runs(self, sights: Sights) -> list[Integers]:
        """Keypoint numbers of each run, in the order of their angles."""
        ...


@method
class Runs:
    """Follows features from each projection to its neighbour along the turn. The default.

    Neighbours look much the same, so most features are found again, and a run gives triplets of
    projections for any step. Where a feature is missed it may be found again some places further.
    """

    reach: Annotated[int, Field(ge=1, le=20)] = 5
    """Places along the turn at which a feature that was missed is still looked for."""

    def runs(self, sights: Sights) -> list[Integers]:
        """Link each keypoint to the nearest projection that shows it again, see `Follower`."""
        links = Links.none(int(sights.first[-1]))
        for away in range(1, self.reach + 1):
            pairs = neighbours(sights.theta, away)
            links.add(sights.matched(pairs, f"matching {away} projections apart"))
        return links.runs(longest=len(sights.theta))


@method
class Steps:
    """Matches projections a fixed step apart, as in the paper's section 3.

    The matches of one step link into runs; any three neighbours in a run are a triplet.
    """

    steps_deg: tuple[Annotated[float, Field(gt=0, lt=90)], ...] = (4.0, 5.0, 10.0)
    """Steps between matched projections, degrees."""

    def runs(self, sights: Sights) -> list[Integers]:
        """Link keypoints for one step after the other, see `Follower`."""
        runs = []
        for step in self.steps_deg:
            links = Links.none(int(sights.first[-1]))
            pairs = a_step_apart(sights.theta, np.deg2rad(step))
            links.add(sights.matched(pairs, f"matching {step:g} degrees apart"))
            runs += links.runs(longest=int(360 / step))
        return runs


FOLLOWERS: Mapping[str, type[Follower]] = {"runs": Runs, "steps": Steps}
