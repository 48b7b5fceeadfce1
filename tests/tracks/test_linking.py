from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tomoslam_stage.geometry import wrapped
from tomoslam_stage.tracks.detectors import Keypoints
from tomoslam_stage.tracks.linking import Links, a_step_apart, neighbours, tracks_of


def linked(count: int, *batches: list[tuple[int, int]]) -> Links:
    links = Links.none(count)
    for batch in batches:
        links.add(np.array(batch))
    return links


def runs(links: Links, longest: int = 100) -> list[list[int]]:
    return [run.tolist() for run in links.runs(longest)]


def test_a_keypoint_is_never_linked_twice() -> None:
    links = linked(6, [(0, 1), (2, 3)], [(0, 4), (5, 3), (4, 5)])
    assert links.next.tolist() == [1, -1, 3, -1, 5, -1]
    assert links.previous.tolist() == [-1, 0, -1, 2, -1, 4]


def test_links_point_both_ways_after_any_pairs() -> None:
    rng = np.random.default_rng(0)
    links = Links.none(60)
    for _ in range(8):
        links.add(np.stack([rng.permutation(60)[:20], rng.permutation(60)[:20]], axis=1))
    here = np.flatnonzero(links.next >= 0)
    assert len(here) > 30
    np.testing.assert_array_equal(links.previous[links.next[here]], here)
    assert (links.previous >= 0).sum() == len(here)


def test_a_chain_becomes_one_run_in_its_order() -> None:
    assert runs(linked(8, [(5, 2), (2, 7)], [(7, 0)])) == [[5, 2, 7, 0]]


def test_a_gap_parts_two_runs() -> None:
    chain = [(0, 1), (1, 2), (3, 4), (4, 5)]
    assert runs(linked(6, chain)) == [[0, 1, 2], [3, 4, 5]]
    assert runs(linked(6, chain, [(2, 3)])) == [[0, 1, 2, 3, 4, 5]]


def test_a_run_of_two_is_no_run() -> None:
    assert runs(linked(5, [(0, 1), (2, 3), (3, 4)])) == [[2, 3, 4]]


def test_what_closes_on_itself_is_cut_open_once() -> None:
    (run,) = runs(linked(5, [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0)]))
    assert sorted(run) == [0, 1, 2, 3, 4]
    assert all((there - here) % 5 == 1 for here, there in pairwise(run))


def test_a_run_longer_than_allowed_is_cut() -> None:
    chain = [(k, k + 1) for k in range(10)]
    assert runs(linked(11, chain), longest=4) == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10]]
    assert runs(linked(11, chain), longest=5) == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]


def test_no_links_make_no_runs() -> None:
    assert runs(Links.none(4)) == []
    assert runs(Links.none(0)) == []


def told(theta_deg: np.ndarray, away: int = 1) -> set[tuple[int, int]]:
    return set(map(tuple, neighbours(np.deg2rad(theta_deg), away).tolist()))


@pytest.mark.parametrize("away", [1, 2, 3])
def test_the_end_of_a_full_turn_is_followed_by_its_beginning(away: int) -> None:
    expected = {(k, (k + away) % 90) for k in range(90)}
    assert told(np.arange(90) * 4.0, away) == expected


@pytest.mark.parametrize("away", [1, 2, 3])
@pytest.mark.parametrize("last", [176.0, 180.0, 200.0])
def test_the_end_of_half_a_turn_is_not(away: int, last: float) -> None:
    theta = np.arange(0, last + 1, 4.0)
    assert told(theta, away) == {(k, k + away) for k in range(len(theta) - away)}


def test_nothing_is_linked_across_a_gap() -> None:
    theta = np.concatenate([np.arange(0, 100, 2.0), np.arange(130, 360, 2.0)])
    found = told(theta)
    assert (49, 50) not in found
    assert len(found) == len(theta) - 1


@pytest.mark.parametrize("turns", [2, 3])
@pytest.mark.parametrize("endpoint", [False, True])
def test_further_turns_fall_between_the_projections_of_the_first(
    turns: int, endpoint: bool
) -> None:
    theta = np.linspace(0, 360 * turns, 90 * turns + endpoint, endpoint=endpoint)
    found = neighbours(np.deg2rad(theta), 1)
    assert len(found) == len(theta)
    assert len(np.unique(found[:, 0])) == len(np.unique(found[:, 1])) == len(theta)
    step = np.rad2deg(wrapped(np.deg2rad(theta[found[:, 1]] - theta[found[:, 0]])))
    assert ((np.abs(step) < 1e-9) | (np.abs(step - 4) < 1e-9)).all()


def test_shuffled_angles_have_the_same_neighbours() -> None:
    theta, order = np.arange(90) * 4.0, np.random.default_rng(1).permutation(90)
    shuffled = {(order[here], order[there]) for here, there in told(theta[order])}
    assert shuffled == told(theta)


def test_a_projection_is_not_its_own_neighbour() -> None:
    assert told(np.array([10.0])) == set()
    assert all(here != there for here, there in told(np.array([0.0, 120.0, 240.0]), away=3))


@pytest.mark.parametrize("seed", range(3))
def test_projections_a_step_apart_are_in_one_pair_each_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    theta = np.deg2rad(rng.permutation(np.arange(120) * 3.0 + rng.uniform(-1, 1, 120)))
    step = np.deg2rad(10)
    found = a_step_apart(theta, step)
    assert len(found) > 50
    for column in found.T:
        assert len(np.unique(column)) == len(found)
    miss = wrapped(theta[found[:, 1]] - theta[found[:, 0]] - step)
    assert np.abs(miss).max() <= 0.2 * step


def test_of_two_that_want_the_same_partner_the_nearer_gets_it() -> None:
    theta = np.deg2rad([0.0, 0.3, 10.2, 150.0])
    assert a_step_apart(theta, np.deg2rad(10)).tolist() == [[1, 2]]


def test_steps_on_a_regular_turn_pair_every_projection() -> None:
    found = a_step_apart(np.deg2rad(np.arange(72) * 5.0), np.deg2rad(10))
    np.testing.assert_array_equal(found, [(k, (k + 2) % 72) for k in range(72)])


def test_no_projection_a_step_apart_gives_no_pairs() -> None:
    assert a_step_apart(np.deg2rad([0.0, 40.0, 80.0]), np.deg2rad(5)).shape == (0, 2)


def test_runs_become_a_table_of_sightings() -> None:
    seen = [
        Keypoints(np.array([1.0, 2]), np.array([5.0, 6]), np.ones(2), np.zeros((2, 4), np.float16)),
        Keypoints(np.array([3.0]), np.array([7.0]), np.ones(1), np.zeros((1, 4), np.float16)),
        Keypoints(np.array([4.0, 9]), np.array([8.0, 9]), np.ones(2), np.zeros((2, 4), np.float16)),
    ]
    tracks = tracks_of([np.array([1, 2, 4]), np.array([3, 2, 0])], seen, fixed=7)
    assert tracks.feature.tolist() == [0, 0, 0, 1, 1, 1]
    assert tracks.projection.tolist() == [0, 1, 2, 2, 1, 0]
    assert tracks.column.tolist() == [2, 3, 9, 4, 3, 1]
    assert tracks.row.tolist() == [6, 7, 9, 8, 7, 5]
    assert tracks.keypoints.tolist() == [2, 1, 2]
    assert tracks.fixed_to_detector == 7


def test_no_runs_become_an_empty_table() -> None:
    none = Keypoints(*(np.empty(0),) * 3, np.empty((0, 4), np.float16))
    tracks = tracks_of([], [none, none], fixed=0)
    assert (tracks.n_features, tracks.n_sightings) == (0, 0)
    assert tracks.projection.dtype == np.intp
