"""Features that are known are found again wherever they appear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tomoslam_stage import parallel
from tomoslam_stage.products import Features, Geometry, Tracks
from tomoslam_stage.tracks import Tracking
from tomoslam_stage.tracks.detectors import Keypoints
from tomoslam_stage.tracks.growing import Growing, Known, Views, one_to_one
from tomoslam_stage.tracks.merging import Candidates, Merging
from tomoslam_stage.tracks.table import KeypointTable

TURN = np.deg2rad(np.arange(0, 360, 4.0))
HALF = np.deg2rad(np.arange(0, 180, 2.0))
SCATTER = 0.2


def reversed_entries(descriptors: np.ndarray) -> np.ndarray:
    """How the descriptors of these scenes look in the mirror."""
    return descriptors[:, ::-1]


@pytest.fixture
def known(scene: Callable[..., Any]) -> Callable[..., tuple[Known, np.ndarray]]:
    """Know all features of a scene from sightings in its first part; and whose each keypoint is."""

    def made(theta: np.ndarray = TURN, part: float = 0.4, **scene_of: Any) -> Any:
        seen = scene(theta, **scene_of)
        # Where projections begin to be compared with the mirror image of those at 0 degrees.
        far = np.cos(theta) < (0 if theta is TURN else np.cos(np.deg2rad(125)))
        keypoints = [
            replace(k, descriptor=reversed_entries(k.descriptor)) if f else k
            for k, f in zip(seen.sights.keypoints, far, strict=True)
        ]
        table = KeypointTable.of(keypoints, reversed_entries)
        keypoint = np.flatnonzero(table.projection < part * len(theta))
        keypoint = keypoint[np.argsort(seen.feature[keypoint], kind="stable")]
        geometry = Geometry(theta, seen.sights.axis)
        tracks = tracked(table, seen.feature[keypoint], keypoint)
        return Known(table, tracks, features_of(tracks, geometry), geometry), seen.feature

    return made


def tracked(table: KeypointTable, feature: np.ndarray, keypoint: np.ndarray) -> Tracks:
    """Tracks of these keypoints."""
    none, nothing = np.empty(0, np.intp), np.empty(0)
    return table.tracks(
        feature, keypoint, Tracks(none, none, nothing, nothing, np.diff(table.first))
    )


def features_of(tracks: Tracks, geometry: Geometry) -> Features:
    """Fit the features of `tracks` by least squares."""
    position, covariance, row = [], [], []
    for number in np.unique(tracks.feature):
        one = tracks.chosen(tracks.feature == number)
        angle = geometry.theta[one.projection]
        design = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        position.append(np.linalg.lstsq(design, one.column - geometry.axis, rcond=None)[0])
        covariance.append(SCATTER**2 * np.linalg.inv(design.T @ design))
        row.append(one.row.mean())
    counts = np.bincount(tracks.feature)
    support = counts[counts > 0].astype(float)
    return Features(np.array(position), np.array(covariance), np.array(row), support, SCATTER)


@pytest.mark.parametrize("theta", [TURN, HALF], ids=["full turn", "half a turn"])
def test_every_sighting_is_found_again_and_none_of_another_feature(
    known: Callable[..., Any], theta: np.ndarray
) -> None:
    before, truth = known(theta)
    grown = Growing().grow(before)
    assert before.tracks.n_sightings < 0.45 * len(before.table)
    assert grown.n_sightings > 0.99 * len(before.table)
    np.testing.assert_array_equal(truth[grown.keypoint], grown.feature)


def test_the_far_side_is_recognised_by_its_mirror_image_alone(known: Callable[..., Any]) -> None:
    before, _ = known()
    table = replace(before.table, mirrored=lambda descriptors: descriptors)
    grown = Growing().grow(replace(before, table=table))
    # Seen from 0 to 140 degrees: the projections across from there have no other view to go by.
    across = np.flatnonzero((np.rad2deg(TURN) > 181) & (np.rad2deg(TURN) < 322))
    assert np.isin(Growing().grow(before).projection, across).any()
    assert not np.isin(grown.projection, across).any()


def test_crowded_features_are_told_apart_by_their_looks(known: Callable[..., Any]) -> None:
    before, truth = known(features=400)
    grown = Growing().grow(before)
    same = (
        truth[grown.keypoint]
        == truth[before.tracks.keypoint][np.searchsorted(before.tracks.feature, grown.feature)]
    )
    assert grown.n_features == 400
    assert same.mean() > 0.99


def test_a_projection_shows_a_feature_once_and_a_keypoint_shows_one(
    known: Callable[..., Any],
) -> None:
    before, _ = known(features=400)
    grown = Growing(distance=2.0).grow(before)
    pairs = np.stack([grown.feature, grown.projection])
    assert len(np.unique(pairs, axis=1).T) == grown.n_sightings
    assert len(np.unique(grown.keypoint)) == grown.n_sightings


def test_outliers_do_not_come_back(known: Callable[..., Any]) -> None:
    before, truth = known()
    feature = before.tracks.feature.copy()
    feature[::20] = (feature[::20] + 7) % 25
    order = np.argsort(feature, kind="stable")
    swapped = tracked(before.table, feature[order], before.tracks.keypoint[order])
    grown = Growing().grow(replace(before, tracks=swapped))
    np.testing.assert_array_equal(truth[grown.keypoint], grown.feature)


def test_short_features_are_dropped_and_the_others_numbered_anew(
    known: Callable[..., Any],
) -> None:
    before, truth = known()
    gone = (truth == 3) & (before.table.projection >= 6)
    table = replace(before.table, column=np.where(gone, 1e4, before.table.column))
    grown = Growing(fewest=8).grow(replace(before, table=table))
    assert np.unique(grown.feature).tolist() == list(range(24))
    assert 3 not in truth[grown.keypoint]


def test_features_that_are_hardly_known_are_not_looked_for(known: Callable[..., Any]) -> None:
    before, _ = known(part=0.15)
    unsure = replace(before.features, covariance=before.features.covariance * 1e4)
    assert Growing().grow(replace(before, features=unsure)).n_sightings == 0


def test_a_leaning_axis_moves_columns_and_rows(known: Callable[..., Any]) -> None:
    before, truth = known()
    table, roll, axis = before.table, np.deg2rad(2.0), before.geometry.axis
    # v = Y - roll u, and the axis lies at axis + roll (v - middle).
    row = table.row - roll * (table.column - axis)
    column = table.column + roll * (row - 60.0)
    leaning = Geometry(TURN, axis, roll, middle=60.0)
    moved = replace(table, row=row, column=column)
    grown = Growing().grow(replace(before, table=moved, geometry=leaning))
    assert grown.n_sightings > 0.98 * len(table)
    np.testing.assert_array_equal(truth[grown.keypoint], grown.feature)


@pytest.mark.parametrize("cores", [1, 5])
def test_the_number_of_workers_changes_nothing(
    known: Callable[..., Any], cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, _ = known(features=100)
    usual = Growing().grow(before)
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: cores)
    again = Growing().grow(before)
    np.testing.assert_array_equal(usual.keypoint, again.keypoint)
    np.testing.assert_array_equal(usual.feature, again.feature)


def test_two_halves_of_a_track_become_one_feature(known: Callable[..., Any]) -> None:
    before, truth = known(part=1.0)
    late = before.table.projection[before.tracks.keypoint] > 50
    feature = before.tracks.feature + 25 * late
    order = np.argsort(feature, kind="stable")
    cut = tracked(before.table, feature[order], before.tracks.keypoint[order])
    both = replace(before, tracks=cut, features=features_of(cut, before.geometry))
    assert both.tracks.n_features == 50
    grown = Growing().grow(both)
    assert grown.n_features == 25
    assert grown.n_sightings > 0.99 * len(before.table)
    for number in range(25):
        assert len(np.unique(truth[grown.keypoint[grown.feature == number]])) == 1


@pytest.mark.parametrize(
    ("apart", "rows", "ratio", "one"),
    [(0.2, 0.3, 1.1, True), (6.0, 0.0, 1.0, False), (0.2, 1.2, 1.0, False), (0.2, 0.0, 1.5, False)],
    ids=["the same", "another place", "another row", "another size"],
)
def test_features_are_one_at_one_place_row_and_size(
    apart: float, rows: float, ratio: float, one: bool
) -> None:
    position = np.array([[5.0, 9.0], [5.0 + apart, 9.0]])
    covariance = np.broadcast_to(0.01 * np.eye(2), (2, 2, 2))
    features = Features(
        position, covariance, np.array([30, 30 + rows]), np.array([9.0, 20.0]), SCATTER
    )
    size = np.log([2.0, 2.0 * ratio])
    becomes = Merging().merged(Candidates(features, size), inflation=2.0)
    assert becomes.tolist() == ([1, 1] if one else [0, 1])


def test_views_are_nearest_modulo_half_a_turn() -> None:
    theta = np.deg2rad([0.0, 40.0, 80.0, 170.0, 215.0])
    none = np.zeros(5)
    feature = np.array([0, 0, 0, 1, 1])
    tracks = Tracks(feature, np.arange(5), none, none, np.ones(5, np.intp))
    views = Views.of(tracks, theta)
    both = np.array([0, 1])
    for angle, nearest, far in [
        (10, [0, 3], [False, True]),
        (75, [2, 4], [False, True]),
        (178, [0, 3], [True, False]),
        (222, [1, 4], [True, False]),
        (-3, [0, 3], [False, True]),
    ]:
        number, mirrored = views.nearest(both, np.deg2rad(angle))
        assert (number.tolist(), mirrored.tolist()) == (nearest, far)


def test_the_best_pairs_are_chosen_first() -> None:
    score = np.array([3.0, 1.0, 2.0, 0.5, 4.0])
    feature, keypoint = np.array([0, 0, 1, 1, 2]), np.array([5, 6, 6, 5, 5])
    # 1-5 first, then 0-6; feature 2 finds its only keypoint taken.
    assert sorted(one_to_one(score, feature, keypoint).tolist()) == [1, 3]


def test_nothing_to_choose_from_is_no_error(known: Callable[..., Any]) -> None:
    before, _ = known()
    blind = Keypoints(*(np.empty(0),) * 3, np.empty((0, 32), np.float16))
    table = KeypointTable.of([blind] * 3, reversed_entries)
    nothing = tracked(table, np.empty(0, np.intp), np.empty(0, np.intp))
    none = np.empty(0)
    features = Features(np.empty((0, 2)), np.empty((0, 2, 2)), none, none, SCATTER)
    grown = Tracking().grow(table, nothing, features, Geometry(TURN[:3], before.geometry.axis))
    assert grown.n_sightings == 0


def test_sightings_are_compared_with_their_track(known: Callable[..., Any]) -> None:
    before, _ = known(theta=HALF[:40], part=1.0)
    tracks = before.tracks
    np.testing.assert_allclose(tracks.unlike, 0, atol=0.05)
    swapped = before.table.descriptor.copy()
    odd = tracks.keypoint[7]
    swapped[odd] = np.roll(swapped[odd], 11)
    size = before.table.size.copy()
    size[odd] *= 1.5
    table = replace(before.table, descriptor=swapped, size=size)
    unlike = table.compared(tracks).unlike
    assert unlike[:, 0].argmax() == unlike[:, 1].argmax() == 7
    assert unlike[7, 1] == pytest.approx(np.log(1.5), rel=0.05)
