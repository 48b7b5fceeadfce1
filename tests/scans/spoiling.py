"""Spoil the bytes of a scan at random, and see what reading it comes to."""

from __future__ import annotations

import os
import signal
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from random import Random

import numpy as np

from tomoslam_stage.cli import main
from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import open_scan

SECONDS = 60
"""A reader that takes longer hangs."""


def spoiled(content: bytes, random: Random) -> bytes:
    """Overwrite a few places, most of them in the headers that HDF5 puts first."""
    changed = bytearray(content)
    for _ in range(random.choice([1, 1, 2, 5, 20])):
        at = random.randrange(random.choice([100, 4096, len(changed)]))
        length = min(random.choice([1, 1, 2, 8, 64]), len(changed) - at)
        kind = random.choice(["random", "zeros", "ones", "flip"])
        if kind == "flip":
            changed[at] ^= 1 << random.randrange(8)
        else:
            fill = {"random": random.randbytes(length), "zeros": bytes(length)}
            changed[at : at + length] = fill.get(kind, b"\xff" * length)
    return bytes(changed)


def read_all(path: Path) -> int:
    """Inspect a file and read it; return the exit code of the program, 3 for a refusal later."""
    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        code = main(["inspect", str(path)])
        if code == 0:
            try:
                scan = open_scan(path)
                scan.source.read(np.arange(scan.n_projections), np.arange(scan.n_rows))
            except ScanError:
                code = 3
    if code not in (0, 3):
        os.write(2, said.getvalue().encode())
    return code


def outcome(path: Path) -> int:
    """Read in a process of its own; return its exit code, or minus the signal that ended it."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            signal.alarm(SECONDS)
            code = read_all(path)
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
