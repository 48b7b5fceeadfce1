from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE

import pytest

from tomoslam_stage.stopping import SIGNALS, Stopped, held_back, stoppable

MAKE = "--phantom grains --projections 60 --rows 64 --columns 96 --seed 5 --error walk:0.2"


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """Let SIGINT be heard, here and in programs started here, even in a shell's background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_where_the_program_stands(number: signal.Signals, code: int) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    with pytest.raises(Stopped) as stop, stoppable():
        signal.raise_signal(number)
    assert stop.value.exit_code == code
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_what_must_be_whole_is_finished_first() -> None:
    done = []

    def edit() -> None:
        with held_back():
            signal.raise_signal(signal.SIGTERM)
            done.append("the edit")
        done.append("what came after it")

    with pytest.raises(Stopped), stoppable():
        edit()
    assert done == ["the edit"]


def test_a_second_signal_does_not_disturb_the_tidying_up() -> None:
    tidied = []

    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)
            tidied.append("draft")

    with pytest.raises(Stopped), stoppable():
        work()
    assert tidied == ["draft"]


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stoppable(), held_back():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_threads_hold_nothing_back_and_hear_nothing() -> None:
    done = []

    def work() -> None:
        with stoppable(), held_back():
            done.append("work")

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == ["work"]


@pytest.mark.parametrize(
    ("name", "said", "code"),
    [("SIGINT", "interrupted", 130), ("SIGTERM", "terminated", 143)],
)
def test_a_run_stops_within_seconds_and_says_what_it_did(
    tmp_path: Path, name: str, said: str, code: int
) -> None:
    scan = tmp_path / "scan.h5"
    program = [sys.executable, "-m", "tomoslam_stage"]
    make = [*program, "simulate", str(scan), *MAKE.split()]
    subprocess.run(make, check=True, capture_output=True)
    before = scan.read_bytes(), scan.stat().st_mtime_ns
    with subprocess.Popen([*program, str(scan)], stderr=PIPE, text=True) as run:
        for line in run.stderr or ():
            if line.startswith("load_scan took"):
                break
        run.send_signal(getattr(signal, name))
        last = run.communicate(timeout=30)[1].splitlines()[-1]
    assert run.returncode == code
    assert last == f"error: {said}; no angles were written, the report is incomplete"
    assert (scan.read_bytes(), scan.stat().st_mtime_ns) == before
    assert list(tmp_path.iterdir()) == [scan]
