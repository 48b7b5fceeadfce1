"""Rows of features of known motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import Floats, Geometry, Rigidity, Tracks
from tomoslam_stage.refinement import Landmarks, rigidity
from tomoslam_stage.refinement.gate import Gate

Sighted = Callable[..., tuple[Tracks, Floats, Geometry]]
NOISE_PX = 0.3
PROJECTIONS = 120
SURE = Gate().rows_significance


@pytest.fixture
def scanned(sighted: Sighted) -> Callable[..., tuple[Tracks, Geometry, Floats]]:
    """Make tracks, their geometry, and for each sighting Y, u, w and the time from 0 to 1."""

    def made(seed: int = 0, features: int = 400) -> tuple[Tracks, Geometry, Floats]:
        tracks, position, truth = sighted(seed=seed, features=features, projections=PROJECTIONS)
        rng = np.random.default_rng(100 + seed)
        x, z = position[tracks.feature].T
        angle = truth.theta[tracks.projection]
        cosine, sine = np.cos(angle), np.sin(angle)
        level = truth.level(tracks.column, tracks.row, tracks.projection) - truth.middle
        when = tracks.projection / PROJECTIONS
        where = np.stack([level, x * cosine + z * sine, z * cosine - x * sine, when])
        column, row = rng.normal(0, NOISE_PX, (2, tracks.n_sightings))
        # Half of the noise hangs together along a track, as that of real keypoints does.
        slow = rng.normal(0, 0.1, (2, features))[:, tracks.feature]
        phase = np.sin(angle + rng.uniform(0, 6.3, features)[tracks.feature])
        column, row = column + slow[0] * phase, row + slow[1] * phase
        return (
            replace(tracks, column=tracks.column + column, row=tracks.row + row),
            truth,
            where,
        )

    return made


Scanned = Callable[..., tuple[Tracks, Geometry, Floats]]


def said(tracks: Tracks, geometry: Geometry, pixel: int = 1) -> Rigidity:
    """Ask rows that can tell."""
    found = rigidity(tracks, geometry, Landmarks(), pixel)
    assert found is not None
    return found


def moved(tracks: Tracks, rows: Floats) -> Tracks:
    return replace(tracks, row=tracks.row + rows)


def test_features_of_a_rigid_sample_keep_their_rows_to_the_noise(scanned: Scanned) -> None:
    found = [said(*scanned(seed)[:2]) for seed in range(12)]
    motion = np.array([each.moved_significance for each in found])
    cone = np.array([each.cone_significance for each in found])
    assert np.abs(motion).max() < SURE / 1.5
    assert np.abs(cone).max() < SURE / 1.5
    assert 0.5 < np.std(cone) < 1.8
    assert max(each.moved_px for each in found) < 0.03


def test_a_sample_that_shrinks_is_told_by_how_much_its_rows_move(scanned: Scanned) -> None:
    tracks, geometry, (height, _, _, when) = scanned()
    rows = -0.01 * height * when
    found = said(moved(tracks, rows), geometry)
    # The row of each feature is not known, so that its mean is taken off.
    mean = np.bincount(tracks.feature, rows) / np.bincount(tracks.feature)
    assert found.moved_px == pytest.approx(np.std(rows - mean[tracks.feature]), rel=0.15)
    assert found.moved_significance > 2 * SURE
    assert abs(found.cone_significance) < SURE


@pytest.mark.parametrize("way", ["sinks", "topples", "leans"])
def test_other_motions_are_told_too(scanned: Scanned, way: str) -> None:
    tracks, geometry, (_, u, w, when) = scanned()
    rows = {"sinks": when, "topples": 0.02 * u * when, "leans": 0.02 * w * when**2}[way]
    found = said(moved(tracks, rows), geometry)
    assert found.moved_significance > 2 * SURE
    assert abs(found.cone_significance) < SURE


def test_a_beam_that_spreads_is_told_by_how_far_apart_rows_move(scanned: Scanned) -> None:
    tracks, geometry, (height, _, w, _) = scanned()
    found = said(moved(tracks, height * w / 4000), geometry)
    assert found.cone_px == pytest.approx(np.abs(height).max() * np.abs(w).max() / 4000, rel=0.1)
    assert found.cone_significance > 2 * SURE
    assert found.moved_significance < SURE


def test_an_axis_that_leans_is_no_motion(scanned: Scanned) -> None:
    tracks, geometry, (_, u, w, _) = scanned()
    plain = said(tracks, geometry)
    leaning = said(moved(tracks, 0.01 * w - 0.004 * u), geometry)
    assert leaning.moved_px == pytest.approx(plain.moved_px, abs=0.01)
    assert leaning.cone_px == pytest.approx(plain.cone_px, abs=0.05)


def test_wrong_angles_hide_nothing_and_false_matches_make_nothing_up(scanned: Scanned) -> None:
    tracks, geometry, (height, _, w, _) = scanned()
    walk = np.random.default_rng(1).normal(0, np.deg2rad(0.05), PROJECTIONS).cumsum()
    astray = replace(geometry, theta=geometry.theta + walk)
    wrong = np.arange(tracks.n_sightings) % 23 == 0
    tracks = replace(tracks, column=tracks.column + 6.0 * wrong, row=tracks.row + 2.0 * wrong)
    still = said(tracks, astray)
    assert still.moved_significance < SURE
    assert abs(still.cone_significance) < SURE
    assert said(moved(tracks, height * w / 4000), astray).cone_significance > 2 * SURE


def test_pixels_are_those_of_the_file(scanned: Scanned) -> None:
    tracks, geometry, (height, _, w, when) = scanned()
    tracks = moved(tracks, height * (w / 4000 - 0.01 * when))
    one, four = said(tracks, geometry), said(tracks, geometry, pixel=4)
    scaled = replace(one, pixel=4, moved_px=4 * one.moved_px, cone_px=4 * one.cone_px)
    assert four == scaled


def test_the_order_of_sightings_changes_nothing(scanned: Scanned) -> None:
    tracks, geometry, _ = scanned()
    order = np.random.default_rng(0).permutation(tracks.n_sightings)
    one, other = said(tracks, geometry), said(tracks.chosen(order), geometry)
    assert other.cone_px == pytest.approx(one.cone_px, abs=1e-6)
    assert other.moved_significance == pytest.approx(one.moved_significance, abs=1e-4)


def test_too_few_features_say_nothing(scanned: Scanned) -> None:
    tracks, geometry, _ = scanned(features=99)
    assert rigidity(tracks, geometry, Landmarks(), 1) is None


def test_features_that_the_angles_do_not_explain_say_nothing(scanned: Scanned) -> None:
    tracks, geometry, _ = scanned()
    wild = np.random.default_rng(2).normal(0, 5, tracks.n_sightings)
    tracks = replace(tracks, column=tracks.column + wild)
    assert rigidity(tracks, geometry, Landmarks(), 1) is None


def test_features_whose_place_is_not_told_are_not_asked(scanned: Scanned) -> None:
    tracks, geometry, _ = scanned()
    first = np.unique(tracks.feature, return_index=True)[1]
    place = np.arange(tracks.n_sightings) - first[tracks.feature]
    some = tracks.feature < 20
    # Two sightings three degrees apart: 8 px between them is a depth of 150 px, outside the field.
    tracks = replace(tracks, column=tracks.column + 8.0 * (some & (place == 1)))
    found = said(tracks.chosen(~some | (place < 2)), geometry)
    without = said(tracks.chosen(~some), geometry)
    assert found.features == without.features
    assert found.cone_px == pytest.approx(without.cone_px, abs=0.02)


def test_some_features_are_enough_on_long_scans(
    scanned: Scanned, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracks, geometry, (height, _, w, _) = scanned()
    tracks = moved(tracks, height * w / 4000)
    everyone = said(tracks, geometry)
    monkeypatch.setattr("tomoslam_stage.refinement.rows.MOST_SIGHTINGS", tracks.n_sightings // 2)
    some = said(tracks, geometry)
    assert some.features == pytest.approx(everyone.features / 2, rel=0.05)
    assert some.cone_px == pytest.approx(everyone.cone_px, rel=0.1)
    assert SURE < some.cone_significance < everyone.cone_significance


def test_a_single_row_says_nothing_about_the_beam(scanned: Scanned) -> None:
    tracks, geometry, _ = scanned()
    flat = replace(tracks, row=np.full(tracks.n_sightings, geometry.middle))
    found = said(flat, replace(geometry, roll=0.0))
    assert (found.moved_px, found.cone_px, found.cone_significance) == (0.0, 0.0, 0.0)
