"""Ctrl-C and SIGTERM while angles are written: nothing half, and the truth about what was done."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from tomoslam_stage.scans import (
    ProcessRecord,
    is_written,
    journal,
    transaction,
    write_companion,
    write_theta,
)
from tomoslam_stage.stopping import Stopped, stoppable

REFINED, SIGMA = np.radians(np.arange(24) * 15.0 + 0.05), np.full(24, 1e-4)
RECORD = ProcessRecord(started="2026-05-01T12:00:00+00:00")


def signalled(call):
    """Let SIGTERM come just before `call`."""

    def after_a_signal(*args, **kwargs):
        signal.raise_signal(signal.SIGTERM)
        return call(*args, **kwargs)

    return after_a_signal


def stopped(write, *args) -> None:
    with pytest.raises(Stopped), stoppable():
        write(*args)


def test_a_copy_that_is_about_to_take_the_place_still_does(scan_file: Path, monkeypatch) -> None:
    monkeypatch.setattr(transaction, "put_in_place", signalled(transaction.put_in_place))
    stopped(write_theta, scan_file, REFINED, SIGMA, RECORD)
    assert is_written(scan_file, RECORD.started)
    assert not is_written(scan_file, "2026-05-01T12:00:01+00:00")
    assert list(scan_file.parent.iterdir()) == [scan_file]


def test_an_edit_in_place_that_has_begun_is_finished(scan_file: Path, monkeypatch) -> None:
    monkeypatch.setattr(transaction, "SMALL", -1)
    monkeypatch.setattr(journal.Journal, "append", signalled(journal.Journal.append))
    stopped(write_theta, scan_file, REFINED, SIGMA, RECORD)
    assert is_written(scan_file, RECORD.started)
    assert list(scan_file.parent.iterdir()) == [scan_file]


def test_copying_stops_at_once_and_leaves_the_scan_alone(scan_file: Path, monkeypatch) -> None:
    before = scan_file.read_bytes(), scan_file.stat().st_mtime_ns
    monkeypatch.setattr(os, "fdatasync", signalled(os.fdatasync))
    stopped(write_theta, scan_file, REFINED, SIGMA, RECORD)
    assert (scan_file.read_bytes(), scan_file.stat().st_mtime_ns) == before
    assert not is_written(scan_file, RECORD.started)
    assert list(scan_file.parent.iterdir()) == [scan_file]


def test_a_companion_appears_whole_or_not_at_all(scan_file: Path, monkeypatch) -> None:
    output = scan_file.with_name("out.h5")
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", signalled(os.fsync))
        stopped(write_companion, output, scan_file, REFINED, SIGMA, RECORD)
    assert list(scan_file.parent.iterdir()) == [scan_file]
    write_companion(output, scan_file, REFINED, SIGMA, RECORD)
    assert is_written(output, RECORD.started)
