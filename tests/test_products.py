from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tomoslam_stage.products import (
    STILL,
    UNKNOWNS,
    AngleMeasurements,
    Geometry,
    Integers,
    Layout,
    Pixels,
    Refinement,
    Scan,
    Tracks,
    Unknown,
)


class Noted:
    """A source that notes what it was asked for."""

    def __init__(self, stack: Pixels) -> None:
        self.stack = stack
        self.shape: tuple[int, int, int] = stack.shape  # type: ignore[assignment]
        self.asked: list[tuple[list[int], list[int]]] = []

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        self.asked.append((projections.tolist(), rows.tolist()))
        return self.stack[np.ix_(projections, rows)]


@pytest.fixture
def source() -> Noted:
    return Noted(np.arange(4 * 3 * 5, dtype=np.float32).reshape(4, 3, 5))


@pytest.fixture
def scan(source: Noted) -> Scan:
    return Scan(source, np.arange(4.0), np.arange(4))


@pytest.fixture
def tracks() -> Tracks:
    return Tracks(
        feature=np.array([2, 2, 7, 7, 7]),
        projection=np.array([0, 1, 0, 1, 2]),
        column=np.array([1.0, 2, 3, 4, 5]),
        row=np.array([6.0, 7, 8, 9, 10]),
        keypoints=np.array([30, 31, 32]),
        fixed_to_detector=4,
    )


@pytest.fixture
def refinement() -> Callable[..., Refinement]:
    def make(**changes: Any) -> Refinement:
        fields = {
            "recorded": np.array([0.0, 1, 2]),
            "refined": np.array([0.0, 1.1, 1.8]),
            "sigma": np.full(3, 0.1),
            "status": "accepted",
            "reason": "told",
            "axes": {"recorded": 10.0, "refined": 11.0},
        }
        return Refinement(**{**fields, **changes})

    return make


@pytest.mark.parametrize(("angles", "frames"), [(3, 4), (5, 4), (4, 3), (4, 5)])
def test_a_scan_needs_an_angle_and_a_frame_for_each_projection(
    source: Noted, angles: int, frames: int
) -> None:
    with pytest.raises(ValueError, match="4 projections need 4 angles and 4 frames") as caught:
        Scan(source, np.arange(float(angles)), np.arange(frames))
    assert str(caught.value).endswith(f"found ({angles},) and ({frames},)")


def test_angles_in_a_matrix_are_refused(source: Noted) -> None:
    with pytest.raises(ValueError, match=r"found \(4, 1\)"):
        Scan(source, np.arange(4.0)[:, None], np.arange(4))


def test_a_scan_knows_its_size_without_reading(scan: Scan, source: Noted) -> None:
    assert (scan.n_projections, scan.n_rows, scan.n_columns) == (4, 3, 5)
    assert source.asked == []


def test_one_projection_is_read_alone_and_whole(scan: Scan, source: Noted) -> None:
    np.testing.assert_array_equal(scan.projection(2), source.stack[2])
    assert source.asked == [([2], [0, 1, 2])]


def test_sinograms_are_read_by_row_from_all_projections(scan: Scan, source: Noted) -> None:
    found = scan.sinograms(np.array([2, 0]))
    assert found.shape == (2, 4, 5)
    np.testing.assert_array_equal(found[0], source.stack[:, 2])
    np.testing.assert_array_equal(found[1], source.stack[:, 0])
    assert source.asked == [([0, 1, 2, 3], [2, 0])]


@pytest.mark.parametrize(
    ("binning", "column", "in_file"), [(1, 3.25, 3.25), (2, 0, 0.5), (4, 2.5, 11.5), (3, 1, 4)]
)
def test_the_middle_of_a_binned_pixel_is_the_middle_of_those_of_the_file(
    source: Noted, binning: int, column: float, in_file: float
) -> None:
    scan = Scan(source, np.arange(4.0), np.arange(4), binning=binning)
    assert scan.column_in_file(column) == pytest.approx(in_file)
    assert scan.column_from_file(in_file) == pytest.approx(column)
    pixels = column * binning + np.arange(binning)
    assert scan.column_in_file(column) == pytest.approx(pixels.mean())


@pytest.mark.parametrize("name", ["feature", "projection", "column", "row"])
def test_the_columns_of_tracks_are_of_one_length(tracks: Tracks, name: str) -> None:
    columns = {key: getattr(tracks, key) for key in ("feature", "projection", "column", "row")}
    columns[name] = columns[name][:-1]
    with pytest.raises(ValueError, match="the columns of Tracks differ in length"):
        Tracks(**columns, keypoints=tracks.keypoints)


def test_tracks_count_sightings_and_features(tracks: Tracks) -> None:
    assert (tracks.n_sightings, tracks.n_features) == (5, 2)


def test_chosen_sightings_keep_their_columns_together(tracks: Tracks) -> None:
    chosen = tracks.chosen(np.array([False, True, True, False, False]))
    assert chosen.feature.tolist() == [2, 7]
    assert chosen.projection.tolist() == [1, 0]
    assert chosen.column.tolist() == [2, 3]
    assert chosen.row.tolist() == [7, 8]
    assert chosen.keypoints is tracks.keypoints
    assert chosen.fixed_to_detector == 4


@pytest.mark.parametrize(
    ("projections", "steps", "covariance"),
    [((6, 2), (6, 2), (6, 2, 2)), ((6, 3), (5, 2), (6, 2, 2)), ((6, 3), (6, 2), (6, 2))],
)
def test_measurements_have_three_projections_two_steps_and_their_covariance(
    projections: tuple[int, ...], steps: tuple[int, ...], covariance: tuple[int, ...]
) -> None:
    counts = np.zeros(6, np.intp)
    with pytest.raises(ValueError, match="the columns of AngleMeasurements have the shapes"):
        AngleMeasurements(
            np.zeros(projections, np.intp), np.zeros(steps), np.zeros(covariance), counts, counts
        )


@pytest.mark.parametrize("m", [0, 6])
def test_measurements_are_counted(m: int) -> None:
    counts = np.zeros(m, np.intp)
    measured = AngleMeasurements(
        np.zeros((m, 3), np.intp), np.zeros((m, 2)), np.zeros((m, 2, 2)), counts, counts
    )
    assert measured.n_measured == m
    assert measured.failures == {}


@pytest.mark.parametrize("name", ["recorded", "refined", "sigma"])
def test_a_refinement_has_as_many_recorded_as_refined_angles_and_sigmas(
    refinement: Callable[..., Refinement], name: str
) -> None:
    with pytest.raises(ValueError, match="recorded, refined and sigma differ in length"):
        refinement(**{name: np.zeros(2)})


@pytest.mark.parametrize(
    ("status", "theta", "axis"), [("accepted", [0, 1.1, 1.8], 11), ("kept", [0, 1, 2], 10)]
)
def test_angles_and_axis_that_stand_go_by_the_status_but_the_change_does_not(
    refinement: Callable[..., Refinement], status: str, theta: list[float], axis: float
) -> None:
    made = refinement(status=status)
    assert made.theta.tolist() == theta
    assert made.axis == axis
    np.testing.assert_allclose(made.change, [0, 0.1, -0.2])


def test_a_refinement_says_nothing_of_rows_where_none_were_held_out(
    refinement: Callable[..., Refinement],
) -> None:
    made = refinement()
    assert made.heldout_rows.shape == (0,)
    assert made.heldout_rows.dtype == np.intp
    assert made.evidence is None


@pytest.mark.parametrize("unknowns", [STILL, UNKNOWNS])
def test_a_geometry_moved_by_a_change_is_that_change_away(unknowns: tuple[Unknown, ...]) -> None:
    start = Geometry(np.arange(3.0), 30.0, 0.1, 12.0, np.array([0.0, 1, 2]), unknowns)
    change = np.arange(1.0, start.layout.size + 1)
    ended = start.moved(change)
    np.testing.assert_allclose(ended.since(start), change)
    assert (ended.axis, ended.roll) == (34.0, 5.1)
    np.testing.assert_array_equal(ended.theta, [1, 3, 5])
    moved = [6.0, 8, 10] if "shift" in unknowns else [0.0, 1, 2]
    np.testing.assert_array_equal(ended.shift, moved)


def test_points_on_the_axis_appear_where_roll_and_shift_put_them() -> None:
    geometry = Geometry(np.zeros(2), 30.0, 0.1, 12.0, np.array([0.0, 0.5]))
    np.testing.assert_allclose(
        geometry.origin(np.array([12.0, 22.0]), np.array([0, 1])), [30, 31.5]
    )
    assert not Geometry(np.zeros(2), 30.0).shift.any()


def test_a_shift_moves_no_row_however_the_axis_leans() -> None:
    geometry = Geometry(np.zeros(2), 30.0, 0.1, 12.0, np.array([0.0, 0.5]))
    level = geometry.level(np.array([35.0, 35.5]), np.array([12.0, 12.0]), np.array([0, 1]))
    np.testing.assert_allclose(level, [12.5, 12.5])


def test_what_is_held_has_a_place_and_is_not_free() -> None:
    held = Layout(3, ("theta", "roll"))
    assert held.size == 5
    assert held.free(held.line).tolist() == [4]
    assert held.free(held.shifts).tolist() == []
    assert held.own == (slice(0, 3),)
    jittered = Layout(3, UNKNOWNS)
    assert jittered.free(slice(0, jittered.size)).tolist() == list(range(8))
    assert jittered.own == (slice(0, 3), slice(5, 8))
