from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.scans.labels import Labels
from tomoslam_stage.scans.pairing import NO_ANGLE, Choice, Pairing, numbers, paired, skipped, spans


def frames(text: str, count: int = 10) -> list[int]:
    return numbers(text, count, "drop_frames").tolist()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", []),
        ("3", [3]),
        ("7, 3", [3, 7]),
        ("2:5", [2, 3, 4]),
        ("1,4:6,5", [1, 4, 5]),
        (":", list(range(10))),
        ("8:", [8, 9]),
        (":2,-1", [0, 1, 9]),
        ("::4", [0, 4, 8]),
        ("8:20", [8, 9]),
    ],
)
def test_frames_are_named_as_python_indexes(text: str, named: list[int]) -> None:
    assert frames(text) == named


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x", r"drop_frames: 'x' cannot be read; numbers and FROM:BEFORE, as in 12,40:43"),
        ("1-3", r"'1-3' cannot be read"),
        ("1:2:3:4", r"'1:2:3:4' cannot be read"),
        ("1:9:0", r"'1:9:0' cannot be read"),
        ("10", r"there is no 10; frames from 0 to 9 are there"),
        ("-11", r"there is no -11; frames from 0 to 9 are there"),
    ],
)
def test_what_names_no_frames_is_refused(text: str, says: str) -> None:
    with pytest.raises(PipelineError, match=says):
        frames(text)


@pytest.mark.parametrize("text", ["", "3", "2:5", "0:2,4,6:10"])
def test_spans_read_as_they_were_written(text: str) -> None:
    assert spans(numbers(text, 10, "keep_frames")) == text


def given(counts: tuple[int, int], labels: Labels | None = None, **choice: str) -> Pairing | None:
    return paired(counts, labels or Labels(), Choice(**choice))


def test_frames_and_angles_of_the_same_number_go_together() -> None:
    pairing = given((5, 5))
    assert pairing is not None
    assert pairing.angle.tolist() == pairing.frames.tolist() == [0, 1, 2, 3, 4]
    assert pairing.left_out == {}


def test_a_dropped_frame_takes_its_own_angle_along_where_every_frame_has_one() -> None:
    pairing = given((5, 5), drop_frames="1,3:")
    assert pairing is not None
    assert pairing.frames.tolist() == [0, 2]
    assert pairing.angle.tolist() == [0, 1, 2, 3, 4]
    assert pairing.left_out == dict.fromkeys([1, 3, 4], "asked for")


def test_an_extra_frame_has_no_angle() -> None:
    pairing = given((5, 4), drop_frames="2")
    assert pairing is not None
    assert pairing.angle.tolist() == [0, 1, NO_ANGLE, 2, 3]
    assert pairing.frames.tolist() == [0, 1, 3, 4]


def test_frames_behind_a_missing_one_take_later_angles() -> None:
    pairing = given((4, 5), drop_angles="2")
    assert pairing is not None
    assert pairing.angle.tolist() == [0, 1, 3, 4]


def test_a_bad_frame_keeps_its_angle_beside_one_that_is_missing() -> None:
    pairing = given((4, 5), drop_angles="2", drop_frames="0")
    assert pairing is not None
    assert pairing.frames.tolist() == [1, 2, 3]
    assert pairing.angle.tolist() == [0, 1, 3, 4]


def test_an_extra_frame_and_a_missing_one_shift_what_lies_between() -> None:
    pairing = given((5, 5), drop_angles="3", drop_frames="1")
    assert pairing is not None
    assert pairing.angle.tolist() == [0, NO_ANGLE, 1, 2, 4]


def test_only_frames_that_are_kept_are_used() -> None:
    pairing = given((6, 6), keep_frames="1:5", drop_frames="3")
    assert pairing is not None
    assert pairing.frames.tolist() == [1, 2, 4]


@pytest.mark.parametrize("counts", [(5, 4), (4, 5)])
def test_nothing_is_guessed(counts: tuple[int, int]) -> None:
    assert given(counts) is None
    assert given(counts, drop_frames="0,1,2") is None


def test_the_images_key_tells_frames_that_are_no_projections() -> None:
    kinds = ("projection", "invalid", "projection", "flat")
    for angles, angle in ((2, [0, NO_ANGLE, 1, NO_ANGLE]), (4, [0, 1, 2, 3])):
        pairing = given((4, angles), Labels(kinds=kinds, kinds_from="/key"))
        assert pairing is not None
        assert pairing.frames.tolist() == [0, 2]
        assert pairing.angle.tolist() == angle
        assert pairing.left_out == {1: "invalid by /key", 3: "flat by /key"}


def test_angles_of_flats_and_darks_are_told_from_those_of_projections() -> None:
    kinds = ("dark", "flat", "projection", "projection", "projection", "flat")
    pairing = given((3, 6), Labels(kinds=kinds, kinds_from="/key"))
    assert pairing is not None
    assert pairing.angle.tolist() == [2, 3, 4]


def test_numbers_of_the_camera_that_skip_tell_which_angles_have_no_frame() -> None:
    pairing = given((4, 7), Labels(ids=np.array([20, 21, 24, 26])))
    assert pairing is None, "the camera's number rises by one as a rule"
    pairing = given((5, 7), Labels(ids=np.array([20, 21, 22, 24, 26])))
    assert pairing is None, "and mostly"
    pairing = given((5, 6), Labels(ids=np.array([20, 21, 22, 24, 25])))
    assert pairing is not None
    assert pairing.angle.tolist() == [0, 1, 2, 4, 5]


def test_numbers_of_the_camera_do_not_tell_what_is_missing_at_an_end() -> None:
    assert given((5, 7), Labels(ids=np.array([20, 21, 22, 24, 25]))) is None
    assert given((4, 5), Labels(ids=np.array([20, 21, 22, 23]))) is None


def test_a_repeated_number_of_the_camera_tells_a_repeated_frame() -> None:
    pairing = given((5, 4), Labels(ids=np.array([7, 8, 8, 9, 10])))
    assert pairing is not None
    assert pairing.angle.tolist() == [0, 1, NO_ANGLE, 2, 3]
    assert "same number from the camera" in pairing.left_out[2]


def test_numbers_that_count_something_else_are_not_believed() -> None:
    assert given((4, 5), Labels(ids=np.array([3, 3, 3, 4]))) is None
    assert given((4, 5), Labels(ids=np.array([9, 8, 10, 13]))) is None


def test_dropped_angles_that_leave_too_few_are_refused() -> None:
    said = r"drop_angles: 4 angles are left for 5 frames, 0 of them left out; one for each"
    with pytest.raises(PipelineError, match=said):
        given((5, 5), drop_angles="1")


def test_frames_may_be_dropped_where_the_file_settles_the_angles() -> None:
    ids = Labels(ids=np.array([20, 21, 22, 24, 25]))
    pairing = given((5, 6), ids, drop_frames="0,1")
    assert pairing is not None
    assert pairing.angle.tolist() == [0, 1, 2, 4, 5]
    assert pairing.frames.tolist() == [2, 3, 4]


def test_what_the_user_says_goes_before_what_the_file_says() -> None:
    pairing = given((5, 6), Labels(ids=np.array([20, 21, 22, 24, 25])), drop_angles="0")
    assert pairing is not None
    assert pairing.angle.tolist() == [1, 2, 3, 4, 5]


def test_a_skipped_number_is_suspect_only_where_the_recorded_step_is_the_usual_one() -> None:
    labels = Labels(ids=np.array([0, 1, 3, 4, 6, 7]))
    usual = np.array([True, True, True, False, True])
    assert skipped(labels, usual).tolist() == [2]
    assert skipped(Labels(), usual).tolist() == []


def test_a_frame_without_an_angle_cannot_be_used() -> None:
    with pytest.raises(ValueError, match=r"frames \[1\] have no angle"):
        Pairing(np.array([0, NO_ANGLE]))
