from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.angles import Triplets
from tomoslam_stage.angles.ransac import Ransac
from tomoslam_stage.angles.triplets import sightings_in, triplets
from tomoslam_stage.geometry import wrapped
from tomoslam_stage.products import AngleMeasurements, Tracks

TURN = np.deg2rad(np.arange(0, 360, 2.0))


def measured(tracks: Tracks, theta: np.ndarray, step: float, **parameters: object):
    return Triplets(steps_deg=(step,), **parameters).measure(tracks, theta, 0.0)


def true_steps(theta: np.ndarray, found: AngleMeasurements) -> np.ndarray:
    return np.diff(theta[found.projections])


@pytest.mark.parametrize("step", [4.0, 10.0, 40.0])
@pytest.mark.parametrize("direction", [1, -1])
def test_every_triplet_of_a_full_turn_is_measured_exactly(
    tracked, step: float, direction: int
) -> None:
    theta = direction * TURN
    found = measured(tracked(theta), theta, step)
    assert found.n_measured == len(theta)
    assert not found.failures
    np.testing.assert_allclose(found.steps, true_steps(theta, found), atol=1e-6)
    assert (found.tracks == 40).all()
    assert (found.inliers == 40).all()


@pytest.mark.parametrize("step", [4.0, 10.0])
def test_closed_form_finds_true_angles_where_recorded_ones_are_wrong(tracked, step: float) -> None:
    recorded = TURN + np.deg2rad(np.random.default_rng(0).uniform(-0.3, 0.3, len(TURN)))
    found = measured(tracked(TURN), recorded, step, closed_form=True)
    assert found.n_measured > 0.9 * len(TURN)
    np.testing.assert_allclose(found.steps, true_steps(TURN, found), atol=1e-6)


@pytest.mark.parametrize("step", [4.0, 10.0])
def test_linearised_steps_converge_to_the_true_ones(tracked, step: float) -> None:
    recorded = TURN + np.deg2rad(np.random.default_rng(0).uniform(-0.3, 0.3, len(TURN)))
    tracks, expected, errors = tracked(TURN), recorded, []
    for _ in range(3):
        found = measured(tracks, expected, step)
        errors.append(np.rad2deg(np.abs(found.steps - true_steps(TURN, found))).max())
        # Half of what is wrong with the expected angles is put right.
        expected = (expected + TURN) / 2
    assert found.n_measured > 0.9 * len(TURN)
    assert errors[0] < 0.2
    # What linearising costs falls with the square of what is wrong.
    assert errors[1] < 0.35 * errors[0]
    assert errors[2] < 0.35 * errors[1]


def test_features_in_one_sheet_still_tell_the_sum_of_both_steps() -> None:
    theta, rng = np.deg2rad([0.0, 10.3, 20.1]), np.random.default_rng(1)
    sheet = 100 * np.cos(theta - 0.4) * rng.uniform(-1, 1, (60, 1)) + rng.normal(0, 0.2, (60, 3))
    sheet += 3 * np.sin(theta - 0.4) * rng.uniform(-1, 1, (60, 1))
    found = one_triplet(sheet, THREE, ransac=Ransac(k_tolerance=50.0), largest_sigma_deg=0.5)
    assert found.n_measured == 1
    variances, axes = np.linalg.eigh(np.rad2deg(np.rad2deg(found.covariance[0])))
    assert np.sqrt(variances[1]) > 4 * np.sqrt(variances[0])
    error = np.rad2deg(found.steps[0] - np.diff(theta))
    assert abs(axes[:, 0] @ error) < 3 * np.sqrt(variances[0]) + 0.05


def test_unequal_steps_are_measured_as_they_are(tracked) -> None:
    theta = np.cumsum(np.deg2rad(np.random.default_rng(1).uniform(0.5, 2.5, 100)))
    found = measured(tracked(theta), theta, 5.0)
    assert found.n_measured > 60
    assert np.ptp(np.rad2deg(found.steps)) > 1
    np.testing.assert_allclose(found.steps, true_steps(theta, found), atol=1e-6)


def test_all_wanted_steps_are_measured_on_overlapping_triplets(tracked) -> None:
    theta = np.deg2rad(np.arange(0, 360, 1.0))
    found = Triplets().measure(tracked(theta, count=15), theta, 0.0)
    sizes = np.rad2deg(wrapped(found.steps[:, 0])).round().astype(int)
    assert Counter(sizes.tolist()) == {4: 360, 5: 360, 10: 360, 20: 360}


def test_order_of_the_projections_changes_nothing(tracked) -> None:
    order = np.random.default_rng(3).permutation(len(TURN))
    tracks = tracked(TURN, scatter=0.1)
    place = np.empty(len(TURN), np.intp)
    place[order] = np.arange(len(TURN))
    shuffled = replace(tracks, projection=place[tracks.projection])
    one = measured(tracks, TURN, 4.0)
    other = measured(shuffled, TURN[order], 4.0)
    first, second = (
        dict(zip(map(tuple, projections.tolist()), m.steps, strict=True))
        for projections, m in ((one.projections, one), (order[other.projections], other))
    )
    assert first.keys() == second.keys()
    np.testing.assert_allclose([first[t] for t in first], [second[t] for t in first], atol=1e-9)


def test_an_axis_that_is_wrong_by_some_px_does_not_matter(tracked) -> None:
    tracks = tracked(TURN, axis=100.0, scatter=0.1)
    right, wrong = (Triplets(steps_deg=(10.0,)).measure(tracks, TURN, c) for c in (100.0, 103.0))
    assert right.n_measured == wrong.n_measured == len(TURN)
    # Other tracks may be taken for outliers; where they are the same, so are the steps.
    apart = np.rad2deg(np.abs(right.steps - wrong.steps))
    assert np.median(apart) < 1e-6
    assert apart.max() < 0.3


def test_wrong_tracks_are_left_out(tracked) -> None:
    tracks = tracked(TURN, count=60, scatter=0.05)
    wrong = tracks.feature < 24
    jumps = np.random.default_rng(0).uniform(-60, 60, tracks.n_sightings)
    found = measured(replace(tracks, column=tracks.column + wrong * jumps), TURN, 10.0)
    assert found.n_measured > 0.95 * len(TURN)
    assert np.rad2deg(np.abs(found.steps - true_steps(TURN, found))).max() < 0.3
    assert (found.inliers < 45).all()
    assert (found.tracks == 60).all()


def test_sigma_of_the_steps_is_the_error_they_have(tracked) -> None:
    found = measured(tracked(TURN, count=80, scatter=0.2), TURN, 10.0)
    error = found.steps - true_steps(TURN, found)
    assert found.n_measured > 0.95 * len(TURN)
    pull = error / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert 0.8 < pull.std() < 1.3


THREE = np.deg2rad([0.0, 10.0, 20.0])


def one_triplet(columns: np.ndarray, theta: np.ndarray, **parameters: object) -> AngleMeasurements:
    """Measure the triplet of three projections with these columns (t, 3)."""
    count = len(columns)
    tracks = Tracks(
        feature=np.repeat(np.arange(count), 3),
        projection=np.tile(np.arange(3), count),
        column=columns.ravel(),
        row=np.zeros(3 * count),
        keypoints=np.full(3, count),
    )
    step = float(np.rad2deg(np.mod(theta[1] - theta[0], 2 * np.pi)))
    return measured(tracks, theta, step, **parameters)


def failures(columns: np.ndarray, theta: np.ndarray = THREE, **parameters: object) -> dict:
    """Count why the triplet of three projections with these columns (t, 3) was not measured."""
    found = one_triplet(columns, theta, **parameters)
    assert found.projections.shape == (0, 3)
    assert found.steps.shape == (0, 2)
    assert found.covariance.shape == (0, 2, 2)
    return dict(found.failures)


def test_too_few_tracks_are_counted(columns) -> None:
    assert failures(columns(THREE, 5, 1)) == {"too few tracks": 1}


def test_six_tracks_that_agree_are_enough(columns) -> None:
    found = one_triplet(columns(THREE, 6, 1), THREE)
    assert found.inliers.tolist() == [6]
    np.testing.assert_allclose(found.steps[0], np.diff(THREE), atol=1e-6)


def test_tracks_that_do_not_agree_are_counted() -> None:
    noise = np.random.default_rng(1).uniform(-100, 100, (30, 3))
    assert failures(noise, ransac=Ransac(k_tolerance=0.01)) == {"too few tracks agree": 1}


def test_a_minority_that_agrees_is_not_enough(columns) -> None:
    noise = np.random.default_rng(1).uniform(-300, 300, (80, 3))
    mixed = np.concatenate([columns(THREE, 20, 1), noise])
    assert failures(mixed, inlier_share=0.5) == {"too few tracks agree": 1}


def test_a_plane_of_no_triangle_is_counted() -> None:
    x1, x2 = np.random.default_rng(1).normal(0, 40, (2, 30))
    for x3 in (0.5 * x1 + 0.3 * x2, 0.9 * x1 + 1.8 * x2):
        tracks = np.stack([x1, x2, x3], axis=1)
        parameters = {"closed_form": True, "largest_change_deg": 180.0}
        assert failures(tracks, **parameters) == {"no such triangle": 1}
        assert failures(tracks) == {"far from the expected steps": 1}


def test_near_degenerate_triplets_are_counted(columns) -> None:
    near_axis = columns(THREE, 30, 1, radius=2.0)
    noisy = near_axis + np.random.default_rng(1).normal(0, 0.5, (30, 3))
    ransac = Ransac(k_tolerance=50.0)
    assert failures(noisy, ransac=ransac) == {"near-degenerate": 1}
    unworried = {"largest_sigma_deg": 90.0, "largest_change_deg": 180.0}
    assert one_triplet(noisy, THREE, ransac=ransac, **unworried).n_measured == 1


def test_steps_far_from_the_expected_ones_are_counted(columns) -> None:
    far, near = (columns(np.deg2rad([0, step, 2 * step]), 30, 1) for step in (14.0, 11.0))
    assert failures(far) == {"far from the expected steps": 1}
    assert failures(far, closed_form=True) == {"far from the expected steps": 1}
    assert one_triplet(far, THREE, largest_change_deg=8.0).n_measured == 1
    assert one_triplet(near, THREE).n_measured == 1


def test_steps_that_reach_half_a_turn_are_counted(columns) -> None:
    theta = np.deg2rad([0, 85.0, 181.0])
    assert failures(columns(theta, 30, 1), theta) == {"steps out of order": 1}


def test_no_tracks_measure_nothing() -> None:
    none, empty = np.empty(0, np.intp), np.empty(0)
    found = Triplets().measure(Tracks(none, none, empty, empty, np.zeros(180, int)), TURN, 0.0)
    assert found.n_measured == 0
    assert not found.failures


def test_triplets_pair_the_sightings_of_the_same_feature() -> None:
    rng = np.random.default_rng(0)
    features, projections = 6, 12
    seen = np.stack(np.divmod(rng.permutation(features * projections)[:50], projections), axis=1)
    tracks = Tracks(
        feature=seen[:, 0],
        projection=seen[:, 1],
        column=100.0 * seen[:, 0] + seen[:, 1],
        row=np.zeros(50),
        keypoints=np.zeros(projections, int),
    )
    theta = np.deg2rad(10.0) * np.arange(projections)
    sighted = set(map(tuple, seen.tolist()))
    expected = {
        (p, f): [100.0 * f + p + k for k in range(0, 5, 2)]
        for f in range(features)
        for p in range(projections - 4)
        if {(f, p), (f, p + 2), (f, p + 4)} <= sighted
    }
    assert len(expected) > 5
    found = {
        (int(where[0]), int(row[0] // 100)): row.tolist()
        for where, rows in triplets(tracks, theta, np.deg2rad(20.0))
        for row in rows
        if where.tolist() == [where[0], where[0] + 2, where[0] + 4]
    }
    assert found == expected


def test_a_sighting_without_partner_is_told() -> None:
    tracks = Tracks(
        feature=np.array([0, 0, 1, 1]),
        projection=np.array([0, 1, 1, 2]),
        column=np.zeros(4),
        row=np.zeros(4),
        keypoints=np.zeros(3, int),
    )
    assert sightings_in(tracks, np.array([1, 2, -1])).tolist() == [1, -1, 3, -1]
