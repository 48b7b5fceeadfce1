from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import (
    ProcessRecord,
    check_writable,
    describe_scan,
    open_scan,
    revert,
    transaction,
    write_companion,
    write_theta,
)

REFINED = np.radians(np.arange(24) * 15.0 + 0.05)
SIGMA = np.full(24, 1e-4)
RECORD = ProcessRecord(
    parameters={"refine_theta": {"step_deg": [4, 5], "robust": True}, "name": "default"},
    versions={"tomoslam_stage": "0.1.0"},
)


@pytest.fixture(params=["copy", "in place"])
def route(request, monkeypatch):
    """Both ways of editing: small files by copy, large ones in place."""
    if request.param == "in place":
        monkeypatch.setattr(transaction, "SMALL", -1)
    return request.param


def contents(path, *leave_out):
    """Every dataset's bytes and attributes, by name."""
    found = {}
    with h5py.File(path) as file:

        def keep(name, node):
            if isinstance(node, h5py.Dataset) and name not in leave_out:
                attributes = {k: str(v) for k, v in node.attrs.items()}
                found[name] = (str(node.dtype), np.asarray(node[()]).tolist(), attributes)

        file.visititems(keep)
    return found


@pytest.mark.usefixtures("route")
def test_refined_angles_are_written_and_the_recorded_ones_renamed(scan_file):
    with h5py.File(scan_file, "r+") as file:
        file["/exchange/theta"].attrs["encoder"] = "ring 3"
    before = contents(scan_file)
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    after = contents(scan_file)
    assert after["exchange/theta_recorded"] == before.pop("exchange/theta")
    assert after["exchange/theta"] == ("float64", np.degrees(REFINED).tolist(), {"units": "deg"})
    assert after["exchange/theta_sigma"] == (
        "float64",
        np.degrees(SIGMA).tolist(),
        {"units": "deg"},
    )
    assert {name: after[name] for name in before} == before
    assert [p.name for p in scan_file.parent.iterdir()] == [scan_file.name]


def test_shifts_are_noted_with_the_parameters_and_go_with_a_run_that_has_none(scan_file):
    shift = np.linspace(-0.5, 0.5, 24)
    sigma = np.full(24, 0.02)
    write_theta(scan_file, REFINED, SIGMA, replace(RECORD, shift_px=shift, shift_sigma_px=sigma))
    noted = contents(scan_file)
    place = "process/tomoslam_stage/shift_px"
    assert noted[place] == ("float64", shift.tolist(), {"units": "pixel"})
    assert noted["process/tomoslam_stage/shift_sigma_px"][1] == sigma.tolist()
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    again = contents(scan_file)
    assert {place, "process/tomoslam_stage/shift_sigma_px"}.isdisjoint(again)
    names = {name for name in again if name.startswith("exchange/")}
    assert names == {name for name in noted if name.startswith("exchange/")}


@pytest.mark.usefixtures("route")
def test_a_second_run_starts_from_the_recorded_angles_and_appends_a_row(scan_file):
    recorded = open_scan(scan_file).theta
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    first = contents(scan_file)
    np.testing.assert_array_equal(open_scan(scan_file).theta, recorded)
    assert describe_scan(scan_file)["refined"] is True
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    second = contents(scan_file)
    table = [name for name in second if name.startswith("process/table/")]
    assert len(table) == 7
    assert [len(second[name][1]) for name in table] == [2] * 7
    assert {k: v for k, v in second.items() if k not in table} == {
        k: v for k, v in first.items() if k not in table
    }


@pytest.mark.usefixtures("route")
def test_provenance_tells_every_parameter(scan_file):
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    with h5py.File(scan_file) as file:
        actor = file["/process/tomoslam_stage"]
        assert json.loads(actor["parameters"][()]) == RECORD.parameters
        assert json.loads(actor["versions"][()]) == RECORD.versions
        assert bool(actor["settings/refine_theta.robust"][()]) is True
        table = file["/process/table"]
        row = {name: table[name].asstr()[0] for name in table}
    assert row["actor"] == "tomoslam_stage"
    assert row["status"] == "SUCCESS"
    assert row["reference"] == "/process/tomoslam_stage"


@pytest.mark.parametrize("foreign", ["dataset", "fixed strings"])
@pytest.mark.usefixtures("route")
def test_a_table_of_another_shape_is_left_alone(scan_file, foreign):
    with h5py.File(scan_file, "r+") as file:
        if foreign == "dataset":
            file["/process/table"] = np.arange(3)
        else:
            columns = [
                "actor",
                "start_time",
                "end_time",
                "status",
                "message",
                "reference",
                "description",
            ]
            for name in columns:
                file.create_dataset(f"/process/table/{name}", (1,), "S4", maxshape=(None,))
    before = contents(scan_file)
    for _ in range(2):
        write_theta(scan_file, REFINED, SIGMA, RECORD)
    after = contents(scan_file)
    tables = [name for name in before if name.startswith("process/table")]
    assert tables
    assert all(after[name] == before[name] for name in tables)
    assert len(after["process/tomoslam_stage/table/status"][1]) == 2


@pytest.mark.usefixtures("route")
def test_revert_restores_the_recorded_angles_exactly(scan_file):
    before = contents(scan_file)
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    revert(scan_file)
    after = contents(scan_file)
    assert {k: v for k, v in after.items() if not k.startswith("process")} == before
    assert len(after["process/table/message"][1]) == 2
    with pytest.raises(ScanError, match="nothing to revert"):
        revert(scan_file)
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    assert contents(scan_file)["exchange/theta_recorded"] == before["exchange/theta"]


@pytest.mark.usefixtures("route")
def test_mode_and_symbolic_link_survive(scan_file):
    scan_file.chmod(0o640)
    link = scan_file.with_name("link.h5")
    link.symlink_to(scan_file.name)
    write_theta(link, REFINED, SIGMA, RECORD)
    assert link.is_symlink()
    assert stat.S_IMODE(scan_file.stat().st_mode) == 0o640
    assert "exchange/theta_recorded" in contents(scan_file)


def test_a_hard_link_still_names_the_same_file(scan_file):
    other = scan_file.with_name("other.h5")
    other.hardlink_to(scan_file)
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    assert other.samefile(scan_file)
    assert "exchange/theta_recorded" in contents(other)


@pytest.mark.parametrize("place", ["/exchange/theta", "/exchange"])
def test_angles_in_another_file_are_not_edited(scan_file, place):
    path = scan_file.with_name("master.h5")
    with h5py.File(path, "w") as file:
        file[place] = h5py.ExternalLink("scan.h5", place)
        if place != "/exchange":
            file["/exchange/data"] = h5py.ExternalLink("scan.h5", "/exchange/data")
    before = path.read_bytes(), scan_file.read_bytes()
    with pytest.raises(ScanError, match=r"is a link into another file.* Pass --output FILE "):
        write_theta(path, REFINED, SIGMA, RECORD)
    assert (path.read_bytes(), scan_file.read_bytes()) == before


def test_angles_that_do_not_fit_are_not_written(scan_file):
    before = scan_file.read_bytes(), scan_file.stat().st_mtime_ns
    with pytest.raises(ScanError, match=r"\(23,\) refined angles and \(24,\) sigmas for 24 proj"):
        write_theta(scan_file, REFINED[:-1], SIGMA, RECORD)
    with pytest.raises(ScanError, match="1 refined angles are not finite"):
        write_theta(scan_file, np.where(np.arange(24) == 3, np.nan, REFINED), SIGMA, RECORD)
    assert (scan_file.read_bytes(), scan_file.stat().st_mtime_ns) == before


def test_recorded_angles_of_another_program_are_not_touched(scan_file):
    with h5py.File(scan_file, "r+") as file:
        file["/exchange/theta_recorded"] = np.zeros(24)
    with pytest.raises(ScanError, match="theta_recorded is there, but was not made by an earlier"):
        write_theta(scan_file, REFINED, SIGMA, RECORD)


HOLD = """
import sys, h5py
with h5py.File(sys.argv[1], sys.argv[2]) as file:
    print(file["/exchange/theta"][0], flush=True)
    sys.stdin.read()
    print(file["/exchange/theta"][0], flush=True)
"""


@contextmanager
def held(path, mode):
    """Let another process keep the file open; yield what it reads meanwhile."""
    words = [sys.executable, "-c", HOLD, str(path), mode]
    with subprocess.Popen(words, stdin=PIPE, stdout=PIPE, text=True) as other:
        read = [other.stdout.readline()]
        yield read
        read.append(other.communicate()[0])


def test_a_scan_that_another_program_holds_is_not_edited_under_it(scan_file, route):
    before = scan_file.read_bytes()
    for mode in ("r", "r+") if route == "in place" else ("r+",):
        with held(scan_file, mode):
            for attempt in (write_theta, lambda path, *_: check_writable(path)):
                with pytest.raises(ScanError) as error:
                    attempt(scan_file, REFINED, SIGMA, RECORD)
                assert str(error.value) in (
                    "scan.h5: another program has it open, and has to close it first. "
                    "Pass --output FILE to write a file of its own instead.",
                    "scan.h5: another program has it open for writing. "
                    "Wait until that program is done.",
                )
        assert scan_file.read_bytes() == before
    check_writable(scan_file)


def test_a_reader_keeps_the_old_file_while_a_copy_takes_its_place(scan_file):
    with held(scan_file, "r") as read:
        write_theta(scan_file, REFINED, SIGMA, RECORD)
        assert "exchange/theta_recorded" in contents(scan_file)
    assert read == ["0.0\n", "0.0\n"]


def test_a_second_run_of_ours_is_refused_while_one_writes(scan_file, route):
    with (
        transaction.locked(scan_file, readers=route == "copy"),
        pytest.raises(ScanError, match="another program has it open"),
    ):
        write_theta(scan_file, REFINED, SIGMA, RECORD)


def test_a_safe_copy_is_made_however_large_the_scan_is(scan_file, monkeypatch):
    monkeypatch.setattr(transaction, "SMALL", -1)
    monkeypatch.setattr(transaction, "SYNCED", 1000)
    scan_file.chmod(0o640)
    before = scan_file.stat()
    write_theta(scan_file, REFINED, SIGMA, RECORD, safe_copy=True)
    middle = scan_file.stat()
    assert middle.st_ino != before.st_ino
    assert middle.st_mode == before.st_mode
    write_theta(scan_file, REFINED, SIGMA, RECORD)
    assert scan_file.stat().st_ino == middle.st_ino
    revert(scan_file, safe_copy=True)
    assert scan_file.stat().st_ino != middle.st_ino
    assert "exchange/theta_recorded" not in contents(scan_file)


def test_a_safe_copy_that_somebody_would_notice_is_refused(scan_file):
    scan_file.with_name("other.h5").hardlink_to(scan_file)
    before = scan_file.read_bytes()
    for attempt in (
        lambda: write_theta(scan_file, REFINED, SIGMA, RECORD, safe_copy=True),
        lambda: check_writable(scan_file, safe_copy=True),
    ):
        with pytest.raises(ScanError) as error:
            attempt()
        assert str(error.value) == (
            "scan.h5: it has 2 names (hard links), and a copy would take the place of one. "
            "Leave --safe-copy away, or pass --output FILE."
        )
    assert scan_file.read_bytes() == before


def test_a_copy_for_which_there_is_no_room_is_refused_before_any_work(scan_file, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(ScanError, match=r"a copy needs [\d.e-]+ GB in .*; 1e-06 are free"):
        check_writable(scan_file)


NOBODY = 65534


def as_somebody(attempt):
    """Run `attempt` as a user who is not root; return the line it was refused with."""
    end, start = os.pipe()
    child = os.fork()
    if child == 0:
        said = "it was not refused"
        try:
            if os.geteuid() == 0:
                os.setuid(NOBODY)
            attempt()
        except ScanError as error:
            said = str(error)
        finally:
            os.write(start, said.encode())
            os._exit(0)
    os.close(start)
    os.waitpid(child, 0)
    with os.fdopen(end) as told:
        return told.read()


@pytest.fixture
def public(scan_file):
    """The scan in a folder that every user may read."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        path = Path(shutil.copy(scan_file, folder / "scan.h5"))
        if os.geteuid() == 0:
            os.chown(folder, NOBODY, NOBODY)
            os.chown(path, NOBODY, NOBODY)
        yield path
        folder.chmod(0o755)


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("write", [write_theta, lambda path, *_: check_writable(path)])
def test_a_read_only_scan_is_refused_with_a_way_out(public, write):
    public.chmod(0o444)
    assert as_somebody(lambda: write(public, REFINED, SIGMA, RECORD)) == (
        "scan.h5: it may not be written to (Permission denied). "
        "Pass --output FILE to write a file of its own instead."
    )


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("write", [write_theta, lambda path, *_: check_writable(path)])
def test_a_read_only_folder_is_refused_with_a_way_out(public, write):
    public.parent.chmod(0o555)
    assert as_somebody(lambda: write(public, REFINED, SIGMA, RECORD)) == (
        f"scan.h5: {public.parent} may not be written to. Pass --output FILE in a folder of yours."
    )


@pytest.mark.parametrize("place", ["/process", "/process/table", "/process/tomoslam_stage"])
def test_what_is_kept_of_a_run_never_goes_into_another_file(scan_file, place):
    other = scan_file.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file.create_group("kept")
    with h5py.File(scan_file, "r+") as file:
        file[place] = h5py.ExternalLink("other.h5", "/kept")
    before = other.read_bytes(), scan_file.read_bytes()
    with pytest.raises(ScanError, match=f"{place} is a link into another file"):
        write_theta(scan_file, REFINED, SIGMA, RECORD)
    assert (other.read_bytes(), scan_file.read_bytes()) == before


def test_a_companion_holds_the_angles_and_leads_to_the_data(scan_file, tmp_path):
    before = scan_file.read_bytes(), scan_file.stat().st_mtime_ns
    (tmp_path / "results").mkdir()
    output = tmp_path / "results" / "refined.h5"
    for _ in range(2):
        write_companion(output, scan_file, REFINED, SIGMA, RECORD)
    assert (scan_file.read_bytes(), scan_file.stat().st_mtime_ns) == before
    with h5py.File(output) as file:
        np.testing.assert_array_equal(file["/exchange/theta"][()], np.degrees(REFINED))
        assert file.get("/exchange/data", getlink=True).filename == "../scan.h5"
        assert file["/exchange/data"].shape == (24, 6, 16)
    again = open_scan(output)
    np.testing.assert_array_equal(again.theta, open_scan(scan_file).theta)
    np.testing.assert_array_equal(again.projection(3), open_scan(scan_file).projection(3))


def test_a_companion_never_replaces_the_scan_or_a_stranger(scan_file, tmp_path):
    (tmp_path / "thesis.h5").write_text("years of work")
    (tmp_path / "same.h5").hardlink_to(scan_file)
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    for name, message in {
        "scan.h5": "the output is the scan itself",
        "same.h5": "the output is the scan itself",
        "thesis.h5": r"it exists, and is not an earlier output for scan\.h5",
    }.items():
        with pytest.raises(ScanError, match=message):
            write_companion(tmp_path / name, scan_file, REFINED, SIGMA, RECORD)
    with pytest.raises(ScanError, match="there is no folder"):
        write_companion(tmp_path / "none" / "x.h5", scan_file, REFINED, SIGMA, RECORD)
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == before
