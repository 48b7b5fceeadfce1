"""Writing is interrupted at every single call that changes the disk."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import (
    ProcessRecord,
    describe_scan,
    open_scan,
    revert,
    transaction,
    write_theta,
)

REFINED = np.radians(np.arange(24) * 15.0 + 0.05)
SIGMA = np.full(24, 1e-4)
RECORD = ProcessRecord(started="2026-01-01T00:00:00+00:00", ended="2026-01-01T00:00:01+00:00")
CALLS = ("pwrite", "fsync", "fdatasync", "ftruncate", "replace", "unlink", "rename")


class Interrupted:
    """Counts the calls that change the disk, and ends the process or fails at one of them."""

    def __init__(self, at: int, then, lasting: bool = False) -> None:
        self.left, self.then, self.lasting = at, then, lasting

    def wrap(self, call):
        def counted(*args, **kwargs):
            self.left -= 1
            if self.left == 0 or (self.lasting and self.left < 0):
                self.then(call, args)
            return call(*args, **kwargs)

        return counted


def die(call, args):
    """Write half of the bytes, as a disk may, and be gone without any clean-up."""
    if call.__name__ == "pwrite":
        descriptor, data, at = args
        call(descriptor, data[: len(data) // 2 // 512 * 512], at)
    os._exit(9)


def write_until(path: Path, at: int) -> bool:
    """Write in a child process that dies at the given call; return whether it did."""
    child = os.fork()
    if child == 0:
        interrupted = Interrupted(at, die)
        for name in CALLS:
            setattr(os, name, interrupted.wrap(getattr(os, name)))
        try:
            write_theta(path, REFINED, SIGMA, RECORD)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


@pytest.fixture(params=["copy", "in place"])
def route(request, monkeypatch):
    if request.param == "in place":
        monkeypatch.setattr(transaction, "SMALL", -1)
    return request.param


def state(path: Path) -> str:
    """Say whether the scan is all old or all new; anything else fails."""
    with h5py.File(path) as file:
        assert file["/exchange/data"][()].sum() > 0
        theta = file["/exchange/theta"][()]
        if "theta_recorded" not in file["/exchange"]:
            np.testing.assert_array_equal(theta, np.arange(24) * 15.0)
            assert "theta_sigma" not in file["/exchange"]
            assert "process" not in file
            return "old"
        np.testing.assert_array_equal(theta, np.degrees(REFINED))
        np.testing.assert_array_equal(file["/exchange/theta_recorded"][()], np.arange(24) * 15.0)
        np.testing.assert_array_equal(file["/exchange/theta_sigma"][()], np.degrees(SIGMA))
        assert len(file["/process/table/status"]) == 1
        return "new"


def test_killed_at_any_call_the_scan_is_all_old_or_all_new(scan_file, tmp_path, route):
    pixels = open_scan(scan_file).source.read(np.arange(24), np.arange(6))
    seen = []
    for at in range(1, 200):
        folder = tmp_path / f"killed {at}"
        folder.mkdir()
        path = Path(shutil.copy(scan_file, folder / "scan.h5"))
        if not write_until(path, at):
            break
        if route == "copy":
            state(path)  # plain HDF5 opens it at every instant
        recovered = describe_scan(path)["recovered"]
        seen.append((state(path), recovered))
        read = open_scan(path).source.read(np.arange(24), np.arange(6))
        np.testing.assert_array_equal(read, pixels)
        write_theta(path, REFINED, SIGMA, RECORD)  # what was left behind is no obstacle
        assert [p.name for p in folder.iterdir()] == ["scan.h5"]
    assert {"old", "new"} <= {which for which, _ in seen}
    assert {True, False} == {recovered for _, recovered in seen}


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_an_error_of_the_disk_is_one_line_and_loses_nothing(
    scan_file, tmp_path, monkeypatch, number, lasting
):
    def fail(_call, _args):
        raise OSError(number, os.strerror(number))

    outcomes = set()
    for at in range(1, 200):
        folder = tmp_path / f"failed {at}"
        folder.mkdir()
        path = Path(shutil.copy(scan_file, folder / "scan.h5"))
        interrupted = Interrupted(at, fail, lasting)
        unchanged = False
        with monkeypatch.context() as patched:
            for name in CALLS:
                patched.setattr(os, name, interrupted.wrap(getattr(os, name)))
            try:
                write_theta(path, REFINED, SIGMA, RECORD)
            except ScanError as error:
                outcomes.add(str(error).replace(str(folder), "FOLDER"))
                unchanged = "nothing was changed" in str(error)
        if interrupted.left > 0:
            break
        describe_scan(path)
        assert state(path) == ("old" if unchanged else "new")
        assert [p.name for p in folder.iterdir()] == ["scan.h5"]
    assert outcomes
    assert all(outcome.startswith("scan.h5: ") for outcome in outcomes)
    if number == errno.ENOSPC:
        assert any("is full" in outcome for outcome in outcomes)


@pytest.mark.usefixtures("route")
def test_a_full_disk_while_hdf5_writes_leaves_the_scan_and_no_other_file(scan_file):
    import resource

    before = scan_file.read_bytes()
    child = os.fork()
    if child == 0:
        import signal

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        limit = len(before) + 100
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        code = 1
        try:
            write_theta(scan_file, REFINED, SIGMA, RECORD)
        except ScanError:
            code = 3
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
    assert scan_file.read_bytes() == before
    assert [p.name for p in scan_file.parent.iterdir()] == [scan_file.name]


def interrupted_in_place(path: Path, monkeypatch) -> Path:
    """Kill a writer when its journal is complete, and return the journal."""
    monkeypatch.setattr(transaction, "SMALL", -1)
    journal = path.with_name(".scan.h5.tomoslam-journal")
    fresh = path.read_bytes()
    for at in range(1, 200):
        path.write_bytes(fresh)
        assert write_until(path, at)
        if journal.exists():
            return journal
    raise AssertionError("no journal was written")


@pytest.mark.parametrize("step", [open_scan, revert])
def test_the_next_run_finishes_an_interrupted_edit_and_says_so(
    scan_file, monkeypatch, caplog, step
):
    journal = interrupted_in_place(scan_file, monkeypatch)
    step(scan_file)
    assert not journal.exists()
    assert "scan.h5: an interrupted edit was found and finished" in caplog.text


def test_a_damaged_journal_is_never_applied(scan_file, monkeypatch):
    journal = interrupted_in_place(scan_file, monkeypatch)
    before = scan_file.read_bytes()
    journal.write_bytes(journal.read_bytes()[:-1])
    with pytest.raises(ScanError, match=r"an edit was interrupted, but its journal .* is damaged"):
        open_scan(scan_file)
    assert scan_file.read_bytes() == before


def test_a_journal_is_not_applied_to_a_file_changed_since(scan_file, monkeypatch):
    interrupted_in_place(scan_file, monkeypatch)
    changed = bytearray(scan_file.read_bytes())
    changed[96:104] = b"otherone"
    scan_file.write_bytes(changed)
    with pytest.raises(ScanError, match=r"was changed by another program since"):
        describe_scan(scan_file)
    assert scan_file.read_bytes() == changed
