"""Files with frames too many, too few or spoiled: what is said about them, and what is used."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from shutil import copy

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import (
    Choice,
    describe_scan,
    line_integrals,
    open_as_stored,
    open_scan,
    read_truth,
    write_simulated,
)
from tomoslam_stage.simulation import recipe_from, simulate

N, ROWS, COLUMNS = 120, 32, 80
SPANS = {180: {"n_projections": N + 1, "span_deg": 180.0, "endpoint": True}, 360: {}}
PHANTOMS = {
    "grains": {"method": "grains", "grains": 150, "seed": 3},
    "card": {"method": "card", "traces": 40, "seed": 3},
    "foam": {"method": "foam", "seed": 3},
}
Change = Callable[[np.ndarray], np.ndarray]


def simulated(path: Path, phantom: str, span: int) -> Path:
    recipe = {
        "phantom": PHANTOMS[phantom],
        "n_projections": N,
        "rows": ROWS,
        "columns": COLUMNS,
        "axis_offset": 1.5,
        "angle_errors": [{"method": "walk", "sigma_deg": 0.05}],
        "seed": 3,
    }
    write_simulated(path, simulate(recipe_from(recipe | SPANS[span])))
    return path


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, int], Path]:
    """Sound scans, by phantom and span; nobody writes to them."""
    folder = tmp_path_factory.mktemp("sound")
    return {
        (phantom, span): simulated(folder / f"{phantom}{span}.h5", phantom, span)
        for phantom in PHANTOMS
        for span in SPANS
    }


@pytest.fixture
def spoiled(tmp_path: Path, sound: dict[tuple[str, int], Path]) -> Callable[..., Path]:
    """Copy a scan, its frames changed, and any other dataset put in."""

    def spoil(which: tuple[str, int], change: Change, **others: object) -> Path:
        path = Path(copy(sound[which], tmp_path / "scan.h5"))
        with h5py.File(path, "r+") as file:
            frames = change(file["/exchange/data"][()])
            del file["/exchange/data"], file["/defaults/HDF5FrameLocation"]
            file["/exchange/data"] = frames
            for place, value in others.items():
                file[place.replace("__", "/")] = value
        return path

    return spoil


def without(*frames: int) -> Change:
    return lambda stack: np.delete(stack, frames, axis=0)


def repeated(frame: int) -> Change:
    """Put a frame in once more behind itself, with noise of its own."""

    def repeat(stack: np.ndarray) -> np.ndarray:
        again = np.random.default_rng(frame).poisson(stack[frame]).astype(stack.dtype)
        return np.insert(stack, frame + 1, again, axis=0)

    return repeat


def refusal(path: Path) -> str:
    before = path.read_bytes()
    with pytest.raises(ScanError) as error:
        open_scan(path)
    assert error.value.exit_code == 3
    assert path.read_bytes() == before
    return str(error.value)


@pytest.mark.parametrize(("phantom", "span"), [("grains", 180), ("foam", 360)])
def test_the_angle_of_a_missing_frame_is_named_with_the_numbers(
    spoiled: Callable[..., Path], phantom: str, span: int
) -> None:
    path = spoiled((phantom, span), without(37))
    n = N + (span == 180)
    said = refusal(path)
    assert said.startswith(
        f"scan.h5: /exchange/theta holds {n} angles for {n - 1} projections in /exchange/data; one "
        "per projection is needed. A reconstruction explains the images best without angle 37 "
        "(residual 0."
    )
    assert "from frame 36 to 37 they change 1." in said
    assert "times as much as between their neighbours (two steps at once: 1." in said
    assert said.endswith(" times). Pass --drop-angles 37.")
    assert describe_scan(path)["problems"] == [said]


@pytest.mark.parametrize(("lost", "span"), [("first", 180), ("last", 360)])
def test_a_frame_missing_at_an_end_may_be_either(
    spoiled: Callable[..., Path], span: int, lost: str
) -> None:
    said = refusal(spoiled(("grains", span), without(0 if lost == "first" else -1)))
    last = N - 1 + (span == 180)
    assert said.endswith(" would do as well: which end it is only turns all slices.")
    assert f"Pass --drop-angles 0. {last} would" in said or f"angles {last}. 0 would" in said


@pytest.mark.parametrize(("frame", "span"), [(0, 180), (52, 360), (-1, 180)])
def test_a_repeated_frame_is_named_with_the_numbers(
    spoiled: Callable[..., Path], span: int, frame: int
) -> None:
    n = N + (span == 180)
    frame %= n
    said = refusal(spoiled(("grains", span), repeated(frame)))
    assert f"from frame {frame} to {frame + 1} they change 0." in said
    assert said.endswith(
        f"times as much as between their neighbours. Pass --drop-frames {frame + 1}."
    )


def test_several_missing_frames_are_found_together(spoiled: Callable[..., Path]) -> None:
    said = refusal(spoiled(("grains", 360), without(20, 21, 60)))
    assert "best without angle 20:22,60 (" in said
    assert said.endswith("Pass --drop-angles 20:22,60.")


def test_frames_by_the_dozen_are_not_looked_for(spoiled: Callable[..., Path]) -> None:
    said = refusal(spoiled(("grains", 360), without(*range(12))))
    assert "12 cannot be told from 108 images. Pass --drop-angles with their numbers" in said


def test_images_that_are_all_alike_tell_nothing(spoiled: Callable[..., Path]) -> None:
    said = refusal(spoiled(("grains", 360), lambda stack: np.repeat(stack[:1], N - 1, axis=0)))
    assert "The images are all alike, and do not show which." in said


def test_the_option_that_is_named_opens_the_scan(
    spoiled: Callable[..., Path], sound: dict[tuple[str, int], Path]
) -> None:
    whole = open_scan(sound["grains", 180])
    missing = open_scan(spoiled(("grains", 180), without(37)), frames=Choice(drop_angles="37"))
    np.testing.assert_array_equal(missing.theta, np.delete(whole.theta, 37))
    np.testing.assert_array_equal(missing.projection(37), whole.projection(38))
    extra = open_scan(spoiled(("grains", 180), repeated(52)), frames=Choice(drop_frames="53"))
    np.testing.assert_array_equal(extra.theta, whole.theta)
    np.testing.assert_array_equal(extra.frames, np.delete(np.arange(N + 2), 53))
    np.testing.assert_array_equal(extra.projection(53), whole.projection(53))
    assert extra.theta_of_frames is not None
    assert np.isnan(extra.theta_of_frames).nonzero()[0].tolist() == [53]


def test_numbers_of_the_camera_settle_it_and_say_so(
    spoiled: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    ids = np.delete(np.arange(100, 100 + N), 37)
    path = spoiled(("grains", 360), without(37), defaults__NDArrayUniqueId=ids)
    whole = np.linspace(0, 2 * np.pi, N, endpoint=False)
    np.testing.assert_allclose(open_scan(path).theta, np.delete(whole, 37))
    assert "the camera's numbers skip angles 37: these have no frame" in caplog.text


def test_a_skipped_number_beside_angles_of_equal_step_is_warned_of(
    spoiled: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    ids = np.where(np.arange(N) < 40, np.arange(N), np.arange(N) + 2)
    open_scan(spoiled(("grains", 360), lambda stack: stack, defaults__NDArrayUniqueId=ids))
    assert "skips some frames before frame 40, and the recorded step there is the" in caplog.text


def test_the_image_key_settles_it_and_says_so(
    spoiled: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    key = np.zeros(N + 1, np.int8)
    key[40] = 3
    path = spoiled(("grains", 360), repeated(39), exchange__image_key=key)
    scan = open_scan(path)
    assert scan.n_projections == N
    assert scan.left_out == {40: "invalid by /exchange/image_key"}
    assert "frames 40 left out: invalid by /exchange/image_key" in caplog.text


def hurt(stack: np.ndarray) -> np.ndarray:
    """Spoil some frames in different ways."""
    stack[0] = 100
    stack[10] = np.iinfo(stack.dtype).max
    stack[20, : ROWS // 2] = 100
    stack[30, :, COLUMNS // 2 :] = 100
    stack[40] = 100 + (stack[40] - 100.0) * 0.4
    stack[50:53] = 100
    stack[-1] = 100
    return stack


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("phantom", PHANTOMS)
def test_bad_frames_are_found_said_and_left_out(
    spoiled: Callable[..., Path],
    sound: dict[tuple[str, int], Path],
    caplog: pytest.LogCaptureFixture,
    phantom: str,
    span: int,
) -> None:
    whole = open_scan(sound[phantom, span])
    assert caplog.text == ""
    scan = open_scan(spoiled((phantom, span), hurt))
    last = whole.n_projections - 1
    assert list(scan.left_out) == [0, 10, 20, 30, 40, 50, 51, 52, last]
    why = {frame: text.partition(":")[0].split(" of")[0] for frame, text in scan.left_out.items()}
    assert why[0] == why[51] == why[last] == "black"
    assert why[10] == "saturated"
    assert why[40] in ("39%", "40%", "41%")
    assert f"frames 10 left out: {scan.left_out[10]}" in caplog.text
    kept = np.setdiff1d(np.arange(last + 1), list(scan.left_out))
    np.testing.assert_array_equal(scan.frames, kept)
    np.testing.assert_array_equal(scan.theta, whole.theta[kept])
    np.testing.assert_array_equal(scan.theta_of_frames, whole.theta)
    np.testing.assert_array_equal(scan.projection(20), whole.projection(kept[20]))
    truth, all_of_it = read_truth(scan.path, scan.frames), read_truth(scan.path)
    assert truth is not None
    assert all_of_it is not None
    np.testing.assert_array_equal(truth.theta, all_of_it.theta[kept])


def test_frames_of_nan_are_left_out_and_single_dead_pixels_are_not(
    spoiled: Callable[..., Path],
) -> None:
    def nan(stack: np.ndarray) -> np.ndarray:
        stack = stack.astype(np.float32)
        stack[:, 3, 5] = stack[5] = stack[7, : ROWS // 2] = np.nan
        return stack

    scan = open_scan(spoiled(("grains", 360), nan))
    assert scan.left_out == {5: "100% of it NaN", 7: "50% of it NaN"}


def test_frames_that_are_kept_stay_however_they_look(spoiled: Callable[..., Path]) -> None:
    path = spoiled(("grains", 360), hurt)
    assert open_scan(path, frames=Choice(keep_frames=":")).n_projections == N
    some = open_scan(path, frames=Choice(keep_frames="5:45"))
    np.testing.assert_array_equal(some.frames, np.arange(5, 45))


def test_frames_as_they_are_stored_keep_their_place_between_the_flats(
    spoiled: Callable[..., Path],
) -> None:
    path = spoiled(("grains", 360), hurt)
    with h5py.File(path, "r+") as file:  # the beam fades along the scan
        flats = file["/exchange/data_white"][()]
        later = (flats - 100.0) * 0.8 + 100
        del file["/exchange/data_white"]
        file["/exchange/data_white"] = np.concatenate([flats, later])
        file["/process/acquisition/flat_fields/flat_field_mode"] = b"Both"
    once, stored = open_scan(path), open_as_stored(path)
    assert stored.values == "counts"
    np.testing.assert_array_equal(stored.frames, once.frames)
    np.testing.assert_array_equal(line_integrals(stored).projection(60), once.projection(60))


def test_a_scan_of_mostly_bad_frames_is_none(spoiled: Callable[..., Path]) -> None:
    def dark(stack: np.ndarray) -> np.ndarray:
        stack[70:] = 100
        return stack

    said = refusal(spoiled(("grains", 360), dark))
    assert said.startswith("scan.h5: 50 of 120 frames are bad, the first of them 70 (black: 0.0")
    assert said.endswith("Pass --keep-frames with those that are sound.")


def test_too_few_frames_are_refused(sound: dict[tuple[str, int], Path]) -> None:
    with pytest.raises(ScanError, match="2 frames are left; 3 or more are needed"):
        open_scan(sound["grains", 360], frames=Choice(keep_frames="4,9"))


def test_an_angle_that_is_none_matters_only_where_its_frame_is_used(
    spoiled: Callable[..., Path],
) -> None:
    path = spoiled(("grains", 360), lambda stack: stack)
    with h5py.File(path, "r+") as file:
        file["/exchange/theta"][7] = np.nan
    with pytest.raises(ScanError, match="Repair theta, or pass --drop-frames 7"):
        open_scan(path)
    assert open_scan(path, frames=Choice(drop_frames="7")).n_projections == N - 1
