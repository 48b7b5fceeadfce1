"""The contract of every way of following features, and what each does of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.geometry import wrapped
from tomoslam_stage.tracks import FOLLOWERS
from tomoslam_stage.tracks.following import Runs, Steps

SPANS = {"180": np.arange(180.0), "360": np.arange(360.0), "720": np.arange(0, 720, 2.0)}
"""degrees"""

every_follower = pytest.mark.parametrize("name", sorted(FOLLOWERS))
every_span = pytest.mark.parametrize("span", SPANS)


def angles(span: str, order: str = "in order") -> np.ndarray:
    """(n,) radians, in order or not."""
    theta = np.deg2rad(SPANS[span])
    return theta if order == "in order" else np.random.default_rng(2).permutation(theta)


def owners(seen) -> np.ndarray:
    """(k,) projection of each keypoint."""
    return np.repeat(np.arange(len(seen.truth)), [len(part) for part in seen.truth])


@every_follower
@every_span
@pytest.mark.parametrize("order", ["in order", "shuffled"])
def test_every_feature_is_recovered_and_none_is_mixed_with_another(
    scene, name: str, span: str, order: str
) -> None:
    seen = scene(angles(span, order), features=12)
    runs = FOLLOWERS[name]().runs(seen.sights)
    found = [set(seen.feature[run]) for run in runs]
    assert all(len(features) == 1 for features in found)
    assert set.union(*found) == set(range(12))
    sighted = np.unique(np.concatenate(runs))
    assert len(sighted) > 0.7 * len(seen.feature)
    if span != "720":
        assert len(sighted) == len(seen.feature)


@every_follower
@every_span
def test_a_run_goes_onwards_and_sees_each_projection_once(scene, name: str, span: str) -> None:
    seen = scene(angles(span, "shuffled"), features=5)
    owner = owners(seen)
    for run in FOLLOWERS[name]().runs(seen.sights):
        projections = owner[run]
        assert len(np.unique(projections)) == len(run)
        step = wrapped(np.diff(seen.sights.theta[projections]))
        assert step.min() > -1e-9
        assert step.max() < np.deg2rad(10.5)


@every_follower
def test_projections_without_keypoints_give_no_runs(scene, name: str) -> None:
    seen = scene(angles("180")[:30], features=4)
    nothing = [k.chosen(np.zeros(len(k), bool)) for k in seen.sights.keypoints]
    assert FOLLOWERS[name]().runs(replace(seen.sights, keypoints=nothing)) == []


@every_follower
def test_features_of_one_projection_alone_give_no_runs(scene, name: str) -> None:
    seen = scene(angles("180")[:1], features=4)
    assert FOLLOWERS[name]().runs(seen.sights) == []


@every_span
def test_neighbours_link_every_feature_into_one_run(scene, span: str) -> None:
    seen = scene(angles(span, "shuffled"), features=8)
    runs = Runs().runs(seen.sights)
    assert sorted(seen.feature[run[0]] for run in runs) == list(range(8))
    assert {len(run) for run in runs} == {len(seen.sights.theta)}


@pytest.mark.parametrize(
    ("missing", "reach", "count"), [(2, 3, 1), (3, 3, 2), (3, 4, 1), (1, 1, 2)]
)
def test_a_feature_that_was_missed_is_found_again_within_reach(
    scene, missing: int, reach: int, count: int
) -> None:
    seen = scene(angles("180")[:40], features=6)
    hidden = range(20, 20 + missing)
    keypoints = [
        k.chosen(truth != 4) if index in hidden else k
        for index, (k, truth) in enumerate(zip(seen.sights.keypoints, seen.truth, strict=True))
    ]
    feature = np.concatenate(
        [t[t != 4] if index in hidden else t for index, t in enumerate(seen.truth)]
    )
    runs = Runs(reach=reach).runs(replace(seen.sights, keypoints=keypoints))
    assert sum(feature[run[0]] == 4 for run in runs) == count
    assert len(runs) == 5 + count


def test_steps_link_projections_a_step_apart_only(scene) -> None:
    seen = scene(angles("360", "shuffled"), features=3)
    owner = owners(seen)
    steps = set()
    for run in Steps(steps_deg=(4.0, 10.0)).runs(seen.sights):
        between = np.rad2deg(wrapped(np.diff(seen.sights.theta[owner[run]])))
        steps |= set(between.round(6))
    assert steps == {4.0, 10.0}


def test_steps_that_no_two_projections_have_give_no_runs(scene) -> None:
    seen = scene(np.deg2rad(np.arange(0, 180, 7.0)), features=3)
    assert Steps(steps_deg=(4.0,)).runs(seen.sights) == []
