"""Synthetic sightings of known geometry are placed to their noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.products import (
    STILL,
    UNKNOWNS,
    AngleMeasurements,
    Floats,
    Geometry,
    Quadratic,
    Tracks,
    Unknown,
)
from tomoslam_stage.refinement import FactorGraph, solver_with
from tomoslam_stage.refinement.factors import Encoder, Prior
from tomoslam_stage.refinement.landmarks import Landmarks
from tomoslam_stage.refinement.sightings import Sightings

Sighted = Callable[..., tuple[Tracks, Floats, Geometry]]
MIDDLE = 60.0
NOISE_PX = 0.2
STEP = np.deg2rad(0.05)


def with_encoder(recorded: Floats, sigma: float = STEP) -> Callable[[Geometry, Quadratic], Floats]:
    """Solve densely for what sightings and an encoder with a walk say; the first angle is held."""
    n = len(recorded)
    steps = np.diff(np.eye(n), axis=0)
    walk = steps.T @ steps / sigma**2

    def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:
        information, pull = quadratic.information.copy(), quadratic.pull.copy()
        information[:n, :n] += walk
        pull[:n] -= walk @ (geometry.theta - recorded)
        information[0, 0] += 1e10
        information[-2:, -2:] += np.diag([0.04, 1e3])
        return np.asarray(np.linalg.solve(information, pull))

    return solve


def recorded_of(truth: Geometry, seed: int = 4) -> Floats:
    """Angles as an encoder records them that errs by a walk."""
    walk = np.random.default_rng(seed).normal(0, STEP, len(truth.theta)).cumsum()
    return np.asarray(truth.theta + walk - walk[0])


@pytest.mark.parametrize("span", [180.0, 360.0, 720.0])
def test_angles_axis_and_roll_are_found_to_the_noise(sighted: Sighted, span: float) -> None:
    tracks, position, truth = sighted(span, noise=NOISE_PX, outliers=0.05)
    recorded = recorded_of(truth)
    start = Geometry(recorded, truth.axis - 1.5, 0.0, truth.middle)
    found = Landmarks().adjust(tracks, start, with_encoder(recorded))
    before, after = (rms_difference(t, truth.theta) for t in (recorded, found.geometry.theta))
    assert before > np.deg2rad(0.1)
    assert after < np.deg2rad(0.04)
    assert found.geometry.axis == pytest.approx(truth.axis, abs=0.1)
    assert found.geometry.roll == pytest.approx(truth.roll, abs=np.deg2rad(0.02))
    assert found.scale == pytest.approx(NOISE_PX, rel=0.15)
    turned = turned_by(found.features.position, found.geometry.theta - truth.theta)
    assert np.median(np.abs(turned - position)) < NOISE_PX


def test_shifts_of_projections_are_found_along_with_the_angles(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    theta = truth.theta
    shift = np.random.default_rng(7).normal(0, 0.5, len(theta))
    tracks = replace(tracks, column=tracks.column + shift[tracks.projection])
    recorded = recorded_of(truth)
    start = replace(truth, theta=recorded)
    graph = FactorGraph(factors={"prior": Prior(), "encoder": Encoder()})

    def found(unknowns: tuple[Unknown, ...]) -> Geometry:
        begin = replace(start, unknowns=unknowns)
        solve = solver_with(graph, begin, AngleMeasurements.none())
        return Landmarks().adjust(tracks, begin, solve).geometry

    free, fixed = found(UNKNOWNS), found(STILL)
    after, worse = (rms_difference(g.theta, theta) for g in (free, fixed))
    assert after < np.deg2rad(0.04) < worse
    assert not fixed.shift.any()
    # One of all is the axis; once round with the turn is a place of the whole sample.
    gauge = np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=1)
    off = free.shift - shift
    off -= gauge @ np.linalg.lstsq(gauge, off, rcond=None)[0]
    assert np.std(off) < 0.1


def turned_by(position: Floats, difference: Floats) -> Floats:
    """Undo that all angles are off together: the common angle is free."""
    angle = -float(difference.mean())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(position @ turn.T)


def test_outliers_have_no_weight(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    wrong = np.arange(tracks.n_sightings) % 37 == 0
    tracks = replace(tracks, column=tracks.column + 9.0 * wrong)
    found = Landmarks().adjust(tracks, truth, with_encoder(truth.theta))
    assert found.residuals[wrong].min() > 8
    assert found.weights[wrong].max() < 0.02 * np.median(found.weights[~wrong])


def test_residuals_are_in_the_order_of_the_tracks(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    shuffled = np.random.default_rng(0).permutation(tracks.n_sightings)
    solve = with_encoder(truth.theta)
    found, again = (Landmarks().adjust(t, truth, solve) for t in (tracks, tracks.chosen(shuffled)))
    np.testing.assert_allclose(again.residuals, found.residuals[shuffled], atol=1e-6)
    np.testing.assert_allclose(again.weights, found.weights[shuffled], rtol=1e-4)


def test_formal_sigma_is_that_of_the_errors(sighted: Sighted) -> None:
    errors, sigmas = [], []
    for seed in range(6):
        tracks, _, truth = sighted(seed=seed, noise=NOISE_PX)
        recorded = recorded_of(truth, seed)
        start, solve = replace(truth, theta=recorded), with_encoder(recorded)
        found = Landmarks().adjust(tracks, start, solve)
        errors.append(rms_difference(found.geometry.theta, truth.theta))
        sigmas.append(formal_sigma(found.quadratic().information))
    assert np.mean(errors) == pytest.approx(np.mean(sigmas), rel=0.35)


def formal_sigma(information: Floats) -> float:
    """Root mean square of the standard deviations of the angles, the common angle taken out."""
    n = len(information) - 2
    steps = np.diff(np.eye(n), axis=0)
    full = information.copy()
    full[:n, :n] += steps.T @ steps / STEP**2
    full[0, 0] += 1e10
    centre = np.eye(n) - 1 / n
    covariance = centre @ np.linalg.inv(full)[:n, :n] @ centre
    return float(np.sqrt(np.trace(covariance) / n))


def test_errors_that_last_along_a_track_make_the_quadratic_less_sure(sighted: Sighted) -> None:
    tracks, _, truth = sighted()
    rng = np.random.default_rng(3)
    lasting = np.repeat(rng.normal(0, NOISE_PX, tracks.n_sightings // 4 + 1), 4)
    brief = rng.normal(0, NOISE_PX, tracks.n_sightings)
    either = [
        Landmarks().adjust(
            replace(tracks, column=tracks.column + error[: tracks.n_sightings]),
            truth,
            with_encoder(truth.theta),
        )
        for error in (lasting, brief)
    ]
    assert either[0].inflation > 2
    assert either[1].inflation < 1.2
    assert np.trace(either[0].quadratic().information) < 0.6 * np.trace(
        either[1].quadratic().information
    )


def test_sightings_that_do_not_look_like_their_track_count_less(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    rng = np.random.default_rng(5)
    bad = rng.random(tracks.n_sightings) < 0.3
    column = tracks.column + bad * rng.normal(0, 4 * NOISE_PX, len(bad))
    unlike = np.stack([0.2 + 0.4 * bad, np.full(len(bad), 0.1)], axis=1)
    looked = replace(tracks, column=column, unlike=unlike)
    found = Landmarks().adjust(looked, truth, with_encoder(truth.theta))
    by_chance = np.abs(found.residuals) < NOISE_PX / 2
    weights = found.weights[by_chance & bad], found.weights[by_chance & ~bad]
    assert np.median(weights[0]) < 0.3 * np.median(weights[1])


def test_features_are_described_where_they_lie(sighted: Sighted) -> None:
    tracks, position, truth = sighted(noise=NOISE_PX)
    features = Landmarks(rounds=1).adjust(tracks, truth, lambda g, _: np.zeros(len(g.theta) + 2))
    features = features.features
    off = features.position - position
    squared = np.einsum("fi,fij,fj->f", off, np.linalg.inv(features.covariance), off)
    assert 1.0 < np.mean(squared) < 4.0
    assert np.all(features.support <= np.bincount(tracks.feature) * 1.5)
    first = np.unique(tracks.feature, return_index=True)[1]
    lean = truth.roll * (tracks.column - truth.axis)
    np.testing.assert_allclose(features.row, (tracks.row + lean)[first], atol=5e-3)


def test_no_sightings_say_nothing(sighted: Sighted) -> None:
    tracks, _, truth = sighted()
    found = Landmarks().adjust(tracks.chosen(tracks.feature < 0), truth, with_encoder(truth.theta))
    assert found.geometry is truth
    assert not found.quadratic().information.any()
    assert len(found.features) == len(found.residuals) == 0


def test_one_sighting_of_one_feature_is_no_error(sighted: Sighted) -> None:
    tracks, _, truth = sighted()
    found = Landmarks().adjust(tracks.chosen(np.array([5])), truth, with_encoder(truth.theta))
    assert np.isfinite(found.quadratic().information).all()
    np.testing.assert_allclose(found.geometry.theta, truth.theta, atol=1e-4)


def test_the_geometry_stays_where_the_graph_finds_no_answer(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    found = Landmarks().adjust(tracks, truth, lambda _, q: np.full_like(q.pull, np.nan))
    assert found.geometry is truth
    assert np.isfinite(found.residuals).all()


def test_projections_without_sightings_keep_to_the_encoder(sighted: Sighted) -> None:
    tracks, _, truth = sighted(noise=NOISE_PX)
    blind = (tracks.projection >= 20) & (tracks.projection < 24)
    found = Landmarks().adjust(tracks.chosen(~blind), truth, with_encoder(truth.theta))
    assert not found.quadratic().information[20:24].any()
    assert np.abs(found.geometry.theta - truth.theta).max() < np.deg2rad(0.2)


def test_sightings_are_sorted_by_feature_then_by_angle(sighted: Sighted) -> None:
    tracks, _, truth = sighted(span=-180.0)
    sightings = Sightings.of(tracks, truth.theta)
    same = np.diff(sightings.feature) == 0
    assert np.all(np.diff(truth.theta[sightings.projection])[same] > 0)
    np.testing.assert_array_equal(tracks.column[sightings.order], sightings.column)


def test_turns_at_the_very_same_angles_are_no_obstacle(sighted: Sighted) -> None:
    tracks, _, truth = sighted(720.0, noise=NOISE_PX)
    assert np.median(np.diff(np.sort(np.mod(truth.theta, 2 * np.pi)))) < 1e-9
    found = Landmarks().adjust(tracks, truth, with_encoder(truth.theta))
    assert np.isfinite(found.weights).all()
    assert np.isfinite(found.quadratic().information).all()
