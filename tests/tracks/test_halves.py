from __future__ import annotations

import numpy as np

from tomoslam_stage.products import Tracks
from tomoslam_stage.tracks import halves

ROWS = 320


def tracked(rows: np.ndarray, sightings: int = 5) -> Tracks:
    """Features on `rows`, which scatter by up to a px from sighting to sighting."""
    scatter = np.random.default_rng(0).uniform(-1, 1, (len(rows), sightings))
    return Tracks(
        feature=np.repeat(np.arange(len(rows)), sightings),
        projection=np.tile(np.arange(sightings), len(rows)),
        column=np.arange(len(rows) * sightings, dtype=float),
        row=(rows[:, None] + scatter).ravel(),
        keypoints=np.full(sightings, len(rows)),
        fixed_to_detector=3,
    )


def test_every_sighting_is_in_one_half_and_no_feature_in_both() -> None:
    tracks = tracked(np.random.default_rng(1).uniform(1, ROWS - 2, 400))
    first, second = halves(tracks, ROWS)
    assert not set(first.feature) & set(second.feature)
    both = np.concatenate([first.column, second.column])
    assert sorted(both) == sorted(tracks.column)
    assert min(first.n_features, second.n_features) > 150


def test_bands_of_rows_go_to_the_halves_in_turn() -> None:
    middles = (np.arange(16) + 0.5) * ROWS / 16
    first, second = halves(tracked(middles), ROWS)
    assert sorted(set(first.feature)) == list(range(0, 16, 2))
    assert sorted(set(second.feature)) == list(range(1, 16, 2))


def test_the_first_sighting_decides_for_a_feature_on_a_border() -> None:
    border = ROWS / 16
    tracks = tracked(np.full(50, border))
    first, second = halves(tracks, ROWS)
    starts = tracks.row[::5]
    np.testing.assert_array_equal(np.unique(first.feature), np.flatnonzero(starts < border))
    np.testing.assert_array_equal(np.unique(second.feature), np.flatnonzero(starts >= border))


def test_halves_of_nothing_are_empty() -> None:
    nothing = tracked(np.empty(0))
    assert [half.n_sightings for half in halves(nothing, ROWS)] == [0, 0]
