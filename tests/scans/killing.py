"""Kill a process that writes angles, at a random instant, and look at what it left behind."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from random import Random

import h5py
import numpy as np

from tomoslam_stage.scans import (
    ProcessRecord,
    ScanContent,
    create_scan,
    describe_scan,
    transaction,
    write_theta,
)

WAYS = ("copy", "in place")
CHANGED = ("exchange/theta", "exchange/theta_sigma", "process/")


@dataclass(frozen=True)
class Left:
    """What was found after a kill."""

    number: int
    """Writes that are in the scan: all of each of them, and nothing of the next."""
    left: tuple[str, ...]
    """Files beside the scan before anything was recovered."""
    recovered: bool
    """Whether the first look at the scan found something to finish or to undo."""


def make_scan(path: Path, n: int = 24, rows: int = 6, columns: int = 16) -> None:
    """Make a scan of noise."""
    rng = np.random.default_rng(1)
    frames = rng.integers(500, 1000, (n, rows, columns), np.uint16)
    flats = np.full((2, rows, columns), 1000, np.uint16)
    create_scan(path, ScanContent(iter(frames), flats, flats // 10, np.arange(n) * 360.0 / n))


def state(path: Path) -> int:
    """Count the writes in a scan that plain HDF5 opens; what does not fit together fails."""
    with h5py.File(path, "r") as file:
        exchange = file["exchange"]
        if "theta_recorded" not in exchange:
            assert "theta_sigma" not in exchange
            assert "process" not in file
            return 0
        number = int(json.loads(file["process/tomoslam_stage/parameters"][()])["number"])
        recorded = exchange["theta_recorded"][()]
        np.testing.assert_allclose(exchange["theta"][()], recorded + number, rtol=1e-12)
        np.testing.assert_allclose(exchange["theta_sigma"][()], number, rtol=1e-12)
        assert {len(column) for column in file["process/table"].values()} == {number}
        return number


def digest(path: Path) -> dict[str, str]:
    """Hash every dataset that no write may change; the recorded angles go by one name."""
    found: dict[str, str] = {}
    with h5py.File(path, "r") as file:
        recorded = file.get("exchange/theta_recorded", file["exchange/theta"])
        found["recorded"] = hashlib.sha256(recorded[()].tobytes()).hexdigest()

        def keep(name: str, node: object) -> None:
            if isinstance(node, h5py.Dataset) and not name.startswith(CHANGED):
                values = node.asstr()[()] if node.dtype.kind == "O" else node[()]
                found[name] = hashlib.sha256(np.asarray(values).astype("S").tobytes()).hexdigest()

        file.visititems(keep)
    return {name: found[name] for name in found if "theta_recorded" not in name}


def write_once(path: Path, way: str, number: int) -> float:
    """Write angles that tell how often they were written; return the seconds it took."""
    with h5py.File(path, "r") as file:
        exchange = file["exchange"]
        recorded = exchange.get("theta_recorded", exchange["theta"])[()]
    theta, sigma = np.radians(recorded + number), np.radians(np.full(len(recorded), number))
    record = ProcessRecord(parameters={"number": number})
    begin = time.perf_counter()
    write_theta(path, theta, sigma, record, safe_copy=way == "copy")
    return time.perf_counter() - begin


def killed(path: Path, way: str, random: Random, longest: float) -> Left:
    """Let a process write, kill it within `longest` seconds, and recover as our next run does."""
    before, told = state(path), digest(path)
    begun, begins = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            transaction.SMALL = -1
            os.write(begins, b".")
            for number in count(before + 1):
                write_once(path, way, number)
        finally:
            os._exit(1)
    os.read(begun, 1)
    os.close(begun)
    os.close(begins)
    time.sleep(random.uniform(0, longest))
    os.kill(child, signal.SIGKILL)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    left = tuple(sorted(p.name for p in path.parent.iterdir() if p != path))
    if way == "copy":
        state(path)  # before anything is recovered
    recovered = bool(describe_scan(path)["recovered"])
    number = state(path)
    assert number >= before
    assert digest(path) == told
    assert recovered == bool(left)
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    return Left(number, left, recovered)
