from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.tracks import matching
from tomoslam_stage.tracks.detectors import Keypoints
from tomoslam_stage.tracks.matching import Matching, distances

STEP = np.deg2rad(5.0)


def keypoints(count: int = 1, **columns: object) -> Keypoints:
    """`count` keypoints at column 60, row 20, all alike but for what is said."""
    alike = np.eye(1, 8).repeat(count, axis=0)
    given = {
        "column": np.full(count, 60.0),
        "row": np.full(count, 20.0),
        "size": np.full(count, 2.0),
        "descriptor": alike,
    } | {name: np.asarray(values, float) for name, values in columns.items()}
    length = np.linalg.norm(given["descriptor"], axis=1, keepdims=True)
    return Keypoints(**given | {"descriptor": (given["descriptor"] / length).astype(np.float16)})


def pairs(first: Keypoints, second: Keypoints, step: float = 0.0, **parameters: float) -> list:
    return Matching(**parameters).pairs(first, second, step, 60.0).tolist()


def test_every_feature_finds_itself_again(scene) -> None:
    seen = scene(np.array([0.3, 0.3 + STEP]), features=200)
    first, second = seen.sights.keypoints
    found = Matching().pairs(first, second, STEP, seen.sights.axis)
    assert len(found) == 200
    np.testing.assert_array_equal(seen.truth[0][found[:, 0]], seen.truth[1][found[:, 1]])


def test_a_feature_only_one_projection_shows_gets_no_partner(scene) -> None:
    seen = scene(np.array([0.3, 0.3 + STEP]), features=50)
    first, second = seen.sights.keypoints
    kept = seen.truth[1] >= 10
    found = Matching().pairs(first, second.chosen(kept), STEP, seen.sights.axis)
    assert sorted(seen.truth[0][found[:, 0]]) == list(range(10, 50))


def test_only_mutual_neighbours_match() -> None:
    near, nearer = [1.0, 0.3, 0, 0], [1.0, 0.1, 0, 0]
    second = keypoints(descriptor=[[1.0, 0, 0, 0]])
    first = keypoints(2, descriptor=[near, nearer])
    assert pairs(first, second) == [[1, 0]]
    assert pairs(second, first) == [[0, 1]]


@pytest.mark.parametrize(
    ("apart", "tolerance", "matches"),
    [
        (2.0, 2.0, True),
        (2.01, 2.0, False),
        (-2.01, 2.0, False),
        (2.5, 3.0, True),
        (0.6, 0.5, False),
    ],
)
def test_rows_of_a_pair_lie_within_the_tolerance(
    apart: float, tolerance: float, matches: bool
) -> None:
    found = pairs(keypoints(), keypoints(row=[20 + apart]), row_tolerance=tolerance)
    assert found == ([[0, 0]] if matches else [])


def test_rows_may_differ_by_two_px_by_default() -> None:
    assert Matching().row_tolerance == 2.0


def test_a_nearest_neighbour_on_a_forbidden_row_does_not_hide_the_right_one() -> None:
    second = keypoints(2, row=[30, 21], descriptor=[[1.0, 0, 0], [1.0, 0.2, 0]])
    first = keypoints(descriptor=[[1.0, 0, 0]])
    assert pairs(first, second) == [[0, 1]]


@pytest.mark.parametrize("sign", [-1, 1])
def test_columns_of_a_pair_are_those_that_a_turn_by_the_step_allows(sign: int) -> None:
    # A feature at the edge of what is seen, radius 40 px, moves by radius * (1 - cos) at most ...
    first = keypoints(2, column=[100.0, 60.0], row=[20.0, 50.0])
    edge = 60 + 40 * np.cos(STEP)
    slack = 41 * np.deg2rad(1.0) + 2 + 9 * np.sin(STEP)
    second = keypoints(2, column=[edge + 0.9 * slack, 60.0], row=[20.0, 50.0])
    assert pairs(first, second, sign * STEP) == [[0, 0], [1, 1]]
    second = keypoints(2, column=[edge - slack - 1, 60.0], row=[20.0, 50.0])
    assert pairs(first, second, sign * STEP) == [[1, 1]]
    # ... and one before the axis by radius * sin.
    reach = 41 * np.sin(STEP) + 41 * np.deg2rad(1.0) + 2
    for column, found in ((60 + reach - 0.1, [1, 1]), (60 + reach + 0.1, None)):
        second = keypoints(2, column=[100.0, column], row=[20.0, 50.0])
        assert ([1, 1] in pairs(first, second, sign * STEP)) == (found is not None)


def test_a_less_trusted_step_widens_the_window() -> None:
    first, second = keypoints(2, column=[20, 60], row=[9, 20]), keypoints(column=[64.0])
    assert pairs(first, second, step_tolerance_deg=1.0) == []
    assert pairs(first, second, step_tolerance_deg=5.0) == [[1, 0]]


def test_sizes_of_a_pair_are_alike() -> None:
    assert pairs(keypoints(size=[2.0]), keypoints(size=[3.1])) == [[0, 0]]
    assert pairs(keypoints(size=[2.0]), keypoints(size=[3.3])) == []
    assert pairs(keypoints(size=[2.0]), keypoints(size=[3.3]), size_ratio=1.7) == [[0, 0]]


def test_descriptors_too_far_apart_do_not_match() -> None:
    angle = 2 * np.arcsin(0.69 / 2)
    second = keypoints(descriptor=[[np.cos(angle), np.sin(angle)]])
    first = keypoints(descriptor=[[1.0, 0.0]])
    assert pairs(first, second) == [[0, 0]]
    assert pairs(first, second, distance=0.68) == []


@pytest.mark.parametrize("chunk", [1, 3, 17, 10_000])
def test_result_does_not_depend_on_how_many_are_compared_at_once(
    scene, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    seen = scene(np.array([0.3, 0.3 + STEP]), features=150)
    rng = np.random.default_rng(0)
    first, second = (
        replace(k, row=k.row + rng.normal(0, 1, len(k)), descriptor=blurred(k, rng))
        for k in seen.sights.keypoints
    )
    whole = Matching().pairs(first, second, STEP, seen.sights.axis)
    assert 75 < len(whole) < 150
    monkeypatch.setattr(matching, "CHUNK", chunk)
    np.testing.assert_array_equal(Matching().pairs(first, second, STEP, seen.sights.axis), whole)


def blurred(seen: Keypoints, rng: np.random.Generator) -> np.ndarray:
    noisy = seen.descriptor + rng.normal(0, 0.07, seen.descriptor.shape)
    return (noisy / np.linalg.norm(noisy, axis=1, keepdims=True)).astype(np.float16)


@pytest.mark.parametrize(("one", "other"), [(0, 3), (3, 0), (0, 0)])
def test_a_projection_without_keypoints_gives_no_pairs(one: int, other: int) -> None:
    found = Matching().pairs(keypoints(one), keypoints(other), STEP, 60.0)
    assert found.shape == (0, 2)
    assert found.dtype == np.intp


def test_distances_are_those_of_the_descriptors() -> None:
    rng = np.random.default_rng(1)
    first, second = (rng.normal(size=(n, 16)) for n in (4, 5))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    expected = np.linalg.norm(first[:, None] - second, axis=-1)
    found = distances(first.astype(np.float16), second.astype(np.float16))
    np.testing.assert_allclose(found, expected, atol=3e-3)
    assert distances(first[:1].astype(np.float16), first[:1].astype(np.float16))[0, 0] < 0.05
