"""Tracks and geometry improve each other, and what cannot be placed is no error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.products import Floats, Geometry, Quadratic, Tracks
from tomoslam_stage.progress import heard_by
from tomoslam_stage.refinement.landmarks import Landmarks
from tomoslam_stage.stages.landmarks import Turns
from tomoslam_stage.tracks import Tracking
from tomoslam_stage.tracks.detectors import Keypoints
from tomoslam_stage.tracks.table import KeypointTable
from tomoslam_stage.tracks.tracking import Seen

AXIS = 83.4
STEP = np.deg2rad(0.05)
THETA = np.deg2rad(np.arange(0, 360, 3.0))
RECORDED = THETA + np.random.default_rng(8).normal(0, STEP, len(THETA)).cumsum()
START = Geometry(RECORDED, AXIS + 0.4, middle=60.0)


def seen_at(theta: Floats, features: int = 80, length: int = 12) -> Seen:
    """Points that turn about `AXIS`, followed for `length` projections at a time."""
    rng = np.random.default_rng(2)
    radius, phase = 70 * np.sqrt(rng.uniform(0.05, 1, features)), rng.uniform(0, 6.3, features)
    descriptor = rng.normal(size=(features, 32))
    descriptor /= np.linalg.norm(descriptor, axis=1, keepdims=True)
    row, size = rng.uniform(5, 115, features), rng.uniform(1.5, 3, features)
    keypoints = []
    for angle in theta:
        column = radius * np.cos(angle - phase) + AXIS + rng.normal(0, 0.15, features)
        keypoints.append(Keypoints(column, row, size, descriptor.astype(np.float16)))
    table = KeypointTable.of(keypoints, lambda d: d)
    number = np.arange(len(table))
    run = (number % features) + features * (table.projection // length)
    order = np.argsort(run, kind="stable")
    none, nothing = np.empty(0, np.intp), np.empty(0)
    like = Tracks(none, none, nothing, nothing, np.diff(table.first))
    return Seen(table, table.tracks(run[order], number[order], like))


def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:
    """Add an encoder with a walk, and hold the first angle."""
    n = len(RECORDED)
    information, pull = quadratic.information.copy(), quadratic.pull.copy()
    steps = np.diff(np.eye(n), axis=0) / STEP
    information[:n, :n] += steps.T @ steps
    pull[:n] -= steps.T @ (steps @ (geometry.theta - RECORDED))
    information[0, 0] += 1e10
    information[-2:, -2:] += np.diag([1.0, 1e4])
    return np.asarray(np.linalg.solve(information, pull))


def test_short_tracks_grow_together_and_give_the_angles() -> None:
    seen = seen_at(THETA)
    found = Turns(Tracking(), Landmarks(), 8, 0.004).placed(seen, START, solve)
    assert found is not None
    adjusted, tracks = found
    assert seen.tracks.n_features == 800
    assert tracks.n_features == 80
    assert tracks.n_sightings == len(adjusted.residuals) > 0.97 * len(seen.table)
    before = rms_difference(RECORDED, THETA)
    after = rms_difference(adjusted.geometry.theta, THETA)
    assert after < min(np.deg2rad(0.03), before / 5)
    assert adjusted.geometry.axis == pytest.approx(AXIS, abs=0.05)


def test_the_listener_hears_of_each_round() -> None:
    heard: list[tuple[str, int, int]] = []

    def listen(what: str, done: int, total: int) -> None:
        heard.append((what, done, total))

    with heard_by(listen):
        Turns(Tracking(), Landmarks(), 2, 0.004).placed(seen_at(THETA), START, solve)
    assert heard == [("landmarks", 1, 2), ("landmarks", 2, 2)]


def nothing(seen: Seen) -> Seen:
    return replace(seen, tracks=seen.tracks.chosen(seen.tracks.feature < 0))


def few(seen: Seen) -> Seen:
    return replace(seen, tracks=seen.tracks.chosen(seen.tracks.feature < 5))


def brief(seen: Seen) -> Seen:
    return replace(seen, tracks=seen.tracks.chosen(seen.tracks.projection % 12 < 5))


@pytest.mark.parametrize("left", [nothing, few, brief])
def test_too_little_to_go_by_is_told_as_none(left: Callable[[Seen], Seen]) -> None:
    found = Turns(Tracking(), Landmarks(), 4, 0.004).placed(left(seen_at(THETA)), START, solve)
    assert found is None


def test_projections_without_sightings_are_no_error() -> None:
    seen = seen_at(THETA)
    table: Any = seen.table
    lost = (table.projection >= 40) & (table.projection < 46)
    # Keypoints of lost projections lie where no feature ever appears.
    table = replace(table, row=np.where(lost, 1e4, table.row))
    tracks = seen.tracks.chosen(~lost[seen.tracks.keypoint])
    found = Turns(Tracking(), Landmarks(), 6, 0.004).placed(Seen(table, tracks), START, solve)
    assert found is not None
    assert rms_difference(found.adjusted.geometry.theta, THETA) < np.deg2rad(0.05)
