"""NXtomo entries: found, read, written back into, linked to."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import (
    ProcessRecord,
    describe_scan,
    line_integrals,
    open_as_stored,
    open_scan,
    read_truth,
    revert,
    write_companion,
    write_theta,
)
from tomoslam_stage.scans.nxtomo import flat_positions

N, ROWS, COLUMNS = 24, 6, 16
BEAM, DARK = 10_000, 100
PROJECTION, FLAT, DARK_KEY, INVALID = 0, 1, 2, 3
KEYS = np.array([DARK_KEY] * 2 + [FLAT] * 3 + [PROJECTION] * 12 + [FLAT] * 2 + [PROJECTION] * 12)
FRAMES = np.flatnonzero(KEYS == PROJECTION)
ANGLES = np.zeros(len(KEYS))
ANGLES[FRAMES] = np.arange(N) * 15.0
ANGLES[17:19] = 3.25
RECORD = ProcessRecord(parameters={"a": 1}, versions={"tomoslam-stage": "0.1.0"})
ENTRY = "/scan_7"
Nexus = Callable[..., Path]


def stack(integrals: np.ndarray) -> np.ndarray:
    """All frames; the beam of the flats in the middle is brighter by a tenth."""
    frames = np.full((len(KEYS), ROWS, COLUMNS), DARK, np.uint16)
    frames[KEYS == FLAT] += BEAM
    frames[17:19] += BEAM // 10
    frames[FRAMES] = np.round(DARK + BEAM * np.exp(-integrals))
    return frames


def add_entry(file: h5py.File, entry: str, frames: Any, keys: Any, angles: Any) -> None:
    """Write an entry the names of which say little, its plots hard links to its data."""
    classes = {entry: "NXentry", f"{entry}/setup": "NXinstrument", f"{entry}/object": "NXsample"}
    classes |= {f"{entry}/setup/camera": "NXdetector", f"{entry}/plot": "NXdata"}
    for place, named in classes.items():
        file.require_group(place).attrs["NX_class"] = named
    file[f"{entry}/definition"] = "NXtomo"
    file[f"{entry}/setup/camera/data"] = frames
    file[f"{entry}/setup/camera/image_key"] = keys
    file[f"{entry}/setup/camera/x_pixel_size"] = 6.5e-6
    file[f"{entry}/object/rotation_angle"] = angles
    file[f"{entry}/object/rotation_angle"].attrs["units"] = "degree"
    file[f"{entry}/object/name"] = "bone"
    for name, place in (("data", "setup/camera/data"), ("rotation_angle", "object/rotation_angle")):
        file[f"{entry}/plot/{name}"] = file[f"{entry}/{place}"]


@pytest.fixture
def nexus(tmp_path: Path, integrals: np.ndarray) -> Nexus:
    """Write an NXtomo file; `change` may change it."""

    def write(change: Callable[[h5py.File], None] | None = None) -> Path:
        path = tmp_path / "scan.nxs"
        with h5py.File(path, "w") as file:
            add_entry(file, ENTRY, stack(integrals), KEYS, ANGLES)
            if change is not None:
                change(file)
        return path

    return write


def as_radians(file: h5py.File) -> None:
    angles = file[f"{ENTRY}/object/rotation_angle"]
    angles[...] = np.radians(angles[()])
    angles.attrs["units"] = "rad"


def as_virtual(file: h5py.File) -> None:
    place = f"{ENTRY}/setup/camera/data"
    shape, dtype = file[place].shape, file[place].dtype
    with h5py.File(Path(file.filename).with_name("raw.h5"), "w") as raw:
        raw["data"] = file[place][()]
    del file[place], file[f"{ENTRY}/plot/data"]
    layout = h5py.VirtualLayout(shape, dtype)
    layout[:10] = h5py.VirtualSource("raw.h5", "data", shape)[:10]
    layout[10:] = h5py.VirtualSource("raw.h5", "data", shape)[10:]
    file.create_virtual_dataset(place, layout)


def as_subentry(file: h5py.File) -> None:
    file.create_group("/entry1").attrs["NX_class"] = "NXentry"
    file.move(ENTRY, "/entry1/tomo_entry")
    file["/entry1/tomo_entry"].attrs["NX_class"] = "NXsubentry"
    file["/entry1/broken"] = h5py.ExternalLink("gone.h5", "/")


def as_the_nxtomo_package_names_them(file: h5py.File) -> None:
    for old, new in (("setup", "instrument"), ("instrument/camera", "instrument/detector")):
        file.move(f"{ENTRY}/{old}", f"{ENTRY}/{new}")
    file.move(f"{ENTRY}/object", f"{ENTRY}/sample")
    del file[f"{ENTRY}/plot/rotation_angle"]
    file[f"{ENTRY}/plot/rotation_angle"] = h5py.SoftLink(f"{ENTRY}/sample/rotation_angle")


def refined_angles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(m,) radians: refined angles of all frames, and sigmas."""
    scan = open_scan(path)
    theta = np.zeros(len(KEYS))
    theta[scan.frames] = scan.theta + 1e-3
    return theta, np.full(len(KEYS), 1e-4)


@pytest.mark.parametrize(
    "change", [None, as_radians, as_virtual, as_subentry, as_the_nxtomo_package_names_them]
)
def test_projections_are_told_from_flats_and_darks_by_the_key(
    nexus: Nexus, integrals: np.ndarray, change: Any
) -> None:
    scan = open_scan(nexus(change))
    np.testing.assert_array_equal(scan.frames, FRAMES)
    np.testing.assert_allclose(np.degrees(scan.theta), ANGLES[FRAMES])
    assert scan.left_out == {}
    read = scan.source.read(np.arange(N), np.arange(ROWS))
    moment = np.clip((FRAMES - 3) / (17.5 - 3), 0, 1)[:, None, None]
    np.testing.assert_allclose(read, integrals + np.log(1 + 0.1 * moment), atol=2e-3)


def test_the_stored_frames_come_with_their_flats_and_darks(nexus: Nexus) -> None:
    scan = open_as_stored(nexus())
    assert scan.values == "counts"
    assert scan.raw is not None
    assert scan.raw.flats is not None
    assert scan.raw.darks is not None
    assert (scan.raw.flats.shape[0], scan.raw.darks.shape[0]) == (5, 2)
    flats = scan.raw.flats.read(np.arange(5), np.arange(ROWS))
    np.testing.assert_array_equal(flats[:, 0, 0], DARK + np.array([BEAM] * 3 + [11_000] * 2))
    rows, some = np.arange(ROWS), np.arange(N)
    whole = open_scan(nexus()).source.read(some, rows)
    np.testing.assert_array_equal(line_integrals(scan).source.read(some, rows), whole)


def test_flats_with_only_darks_between_them_are_one_group() -> None:
    kinds = ("flat", "dark", "flat", "projection", "invalid", "flat", "projection")
    assert flat_positions(kinds) == (1.0, 1.0, 5.0)


def test_invalid_frames_and_images_for_alignment_are_left_out_by_name(nexus: Nexus) -> None:
    def change(file: h5py.File) -> None:
        control = KEYS.copy()
        control[[20, 28]] = [INVALID, -1]
        file[f"{ENTRY}/setup/camera/image_key_control"] = control

    scan = open_scan(nexus(change))
    place = f"{ENTRY}/setup/camera/image_key_control"
    assert scan.left_out == {20: f"invalid by {place}", 28: f"alignment by {place}"}
    np.testing.assert_array_equal(scan.frames, np.setdiff1d(FRAMES, [20, 28]))


def test_of_several_entries_the_default_is_taken_and_none_is_guessed(nexus: Nexus) -> None:
    def change(file: h5py.File) -> None:
        file.copy(ENTRY, "/scan_8")

    path = nexus(change)
    with pytest.raises(ScanError, match=r"2 NXtomo entries: /scan_7, /scan_8; one is needed"):
        open_scan(path)
    with h5py.File(path, "r+") as file:
        file.attrs["default"] = "scan_8"
        file["/scan_8/object/rotation_angle"][FRAMES] = np.arange(N) * 7.0
    np.testing.assert_allclose(np.degrees(open_scan(path).theta), np.arange(N) * 7.0)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (KEYS[:-1], "holds 30 keys for 31 frames; one for each is needed"),
        (np.where(KEYS == 2, 7, KEYS), "holds 7; 0 (projection), 1 (flat)"),
    ],
)
def test_a_key_that_does_not_fit_is_refused(nexus: Nexus, keys: np.ndarray, said: str) -> None:
    def change(file: h5py.File) -> None:
        del file[f"{ENTRY}/setup/camera/image_key"]
        file[f"{ENTRY}/setup/camera/image_key"] = keys

    path = nexus(change)
    with pytest.raises(ScanError) as refusal:
        open_scan(path)
    assert said in str(refusal.value)
    assert describe_scan(path)["problems"] == [str(refusal.value)]


def test_written_angles_keep_their_length_and_every_name_means_them(nexus: Nexus) -> None:
    path = nexus()
    theta, sigma = refined_angles(path)
    for _ in range(2):  # a second run starts from the recorded angles again
        write_theta(path, theta, sigma, RECORD)
        np.testing.assert_allclose(np.degrees(open_scan(path).theta), ANGLES[FRAMES])
    with h5py.File(path) as file:
        sample, actor = file[f"{ENTRY}/object"], file[f"{ENTRY}/tomoslam_stage"]
        np.testing.assert_array_equal(sample["rotation_angle_recorded"], ANGLES)
        written = sample["rotation_angle"][()]
        np.testing.assert_allclose(written[FRAMES], np.degrees(theta[FRAMES]))
        np.testing.assert_array_equal(written[KEYS != PROJECTION], ANGLES[KEYS != PROJECTION])
        assert sample["rotation_angle"].attrs["units"] == "deg"
        assert np.isnan(sample["rotation_angle_errors"][()]).sum() == 7
        assert file[f"{ENTRY}/plot/rotation_angle"] == sample["rotation_angle"]
        assert actor.attrs["NX_class"] == "NXprocess"
        assert actor["program"].asstr()[()] == "tomoslam_stage"
        assert actor["version"].asstr()[()] == "0.1.0"
        assert json.loads(actor["parameters"][()]) == {"a": 1}
        assert len(actor["table/status"]) == 2
        plot = actor[actor.attrs["default"]]
        assert plot.attrs["signal"] == "correction"
        np.testing.assert_array_equal(plot["frame"], FRAMES)
        np.testing.assert_allclose(plot["correction"], np.degrees(1e-3), rtol=1e-6)
        np.testing.assert_allclose(plot["correction_errors"], np.degrees(1e-4))


def test_revert_puts_the_recorded_angles_back_under_every_name(nexus: Nexus) -> None:
    path = nexus()
    write_theta(path, *refined_angles(path), RECORD)
    assert describe_scan(path)["refined"] is True
    revert(path)
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file[f"{ENTRY}/object/rotation_angle"], ANGLES)
        assert file[f"{ENTRY}/plot/rotation_angle"] == file[f"{ENTRY}/object/rotation_angle"]
        assert sorted(file[f"{ENTRY}/object"]) == ["name", "rotation_angle"]
        assert "correction" not in file[f"{ENTRY}/tomoslam_stage"]


def test_angles_that_lie_in_another_file_are_not_edited_but_a_companion_is_made(
    nexus: Nexus, tmp_path: Path
) -> None:
    def change(file: h5py.File) -> None:
        place = f"{ENTRY}/object/rotation_angle"
        with h5py.File(tmp_path / "motors.h5", "w") as motors:
            file.copy(place, motors, "theta")
        del file[place], file[f"{ENTRY}/plot/rotation_angle"]
        file[place] = h5py.ExternalLink("motors.h5", "/theta")

    path = nexus(change)
    before = path.read_bytes(), (tmp_path / "motors.h5").read_bytes()
    theta, sigma = refined_angles(path)
    with pytest.raises(ScanError, match=r"link into another file.*--output"):
        write_theta(path, theta, sigma, RECORD)
    write_companion(tmp_path / "refined.nxs", path, theta, sigma, RECORD)
    assert (path.read_bytes(), (tmp_path / "motors.h5").read_bytes()) == before


def test_a_companion_is_an_entry_of_its_own_with_links_to_the_scan(
    nexus: Nexus, tmp_path: Path
) -> None:
    path = nexus(as_subentry)
    (tmp_path / "there").mkdir()
    companion = tmp_path / "there" / "refined.nxs"
    write_companion(companion, path, *refined_angles(path), RECORD)
    assert describe_scan(companion)["refined"] is True
    some, rows = np.arange(N), np.arange(ROWS)
    read = [open_scan(each).source.read(some, rows) for each in (path, companion)]
    np.testing.assert_array_equal(*read)
    with h5py.File(companion) as file:
        entry = file["/entry1/tomo_entry"]
        assert entry.attrs["NX_class"] == "NXsubentry"
        assert entry["definition"].asstr()[()] == "NXtomo"
        assert entry["object/name"].asstr()[()] == "bone"
        assert entry["setup/camera/x_pixel_size"][()] == 6.5e-6
        assert entry["plot/rotation_angle"] == entry["object/rotation_angle"]
        np.testing.assert_array_equal(entry["object/rotation_angle_recorded"], ANGLES)
        assert companion.stat().st_size < path.stat().st_size + 60_000


def test_nothing_is_known_of_the_truth_about_a_real_entry(nexus: Nexus) -> None:
    assert read_truth(nexus()) is None


def test_a_stack_without_a_key_holds_projections_only(nexus: Nexus, integrals: np.ndarray) -> None:
    def change(file: h5py.File) -> None:
        for place in ("setup/camera/data", "setup/camera/image_key", "object/rotation_angle"):
            del file[f"{ENTRY}/{place}"]
        file[f"{ENTRY}/setup/camera/data"] = integrals
        file[f"{ENTRY}/object/rotation_angle"] = np.arange(N) * 15.0

    scan = open_scan(nexus(change))
    assert scan.n_projections == N
    assert scan.values == "line_integrals"


def test_the_nxtomo_package_opens_what_was_written(nexus: Nexus, tmp_path: Path) -> None:
    pytest.importorskip("nxtomo", reason="a check of the neighbour itself; installed by hand")
    from nxtomo.application.nxtomo import NXtomo

    path, companion = nexus(as_the_nxtomo_package_names_them), tmp_path / "refined.nxs"
    theta, sigma = refined_angles(path)
    write_companion(companion, path, theta, sigma, RECORD)
    write_theta(path, theta, sigma, RECORD)
    for each in (path, companion):
        read = NXtomo().load(str(each), ENTRY.strip("/"))
        angles = read.sample.rotation_angle.to("degree").magnitude
        np.testing.assert_allclose(angles[FRAMES], np.degrees(theta[FRAMES]))
