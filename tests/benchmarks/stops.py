"""Stop runs by Ctrl-C and SIGTERM at random instants, and tell how long they take to stop.

``python tests/benchmarks/stops.py [STOPS]``: a simulated scan is refined STOPS times (20), each
time stopped at a random instant. The run must end with 130 or 143 and one line, with no draft
left behind, and with the scan as it was unless that line says otherwise.
"""

from __future__ import annotations

import hashlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from random import Random
from subprocess import DEVNULL, PIPE

PROGRAM = [sys.executable, "-m", "tomoslam_stage"]
RECIPE = "--phantom grains --projections 90 --rows 96 --columns 128 --seed 5 --error lost_step:2.5"
STARTED = 1.0
"""s, after which the program listens; before, nothing is there to be stopped."""
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}


def stopped(scan: Path, number: signal.Signals, after: float) -> tuple[float, str]:
    """Stop a run after a time; return the seconds until it ended, and its last line."""
    before = hashlib.sha256(scan.read_bytes()).hexdigest()
    with subprocess.Popen([*PROGRAM, str(scan)], stdout=DEVNULL, stderr=PIPE, text=True) as run:
        time.sleep(after)
        begin = time.perf_counter()
        run.send_signal(number)
        said = run.communicate(timeout=60)[1]
    took, last = time.perf_counter() - begin, said.splitlines()[-1]
    if run.returncode not in CODES.values():
        return took, f"had ended already with {run.returncode}"
    assert run.returncode == CODES[number], said
    assert "Traceback" not in said
    assert not [p.name for p in scan.parent.rglob(".*")]
    changed = hashlib.sha256(scan.read_bytes()).hexdigest() != before
    assert changed == ("holds the refined angles" in last), last
    return took, last


def main(stops: int = 20) -> None:
    """Stop runs, and print what each said."""
    random, seconds = Random(3), []
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made.h5"
        subprocess.run([*PROGRAM, "simulate", str(made), *RECIPE.split()], check=True)
        begin = time.perf_counter()
        subprocess.run([*PROGRAM, str(made), "--dry-run"], check=False, capture_output=True)
        whole = time.perf_counter() - begin
        for each in range(stops):
            place = Path(folder) / str(each)
            place.mkdir()
            scan = Path(shutil.copy(made, place / "scan.h5"))
            number, after = random.choice(list(CODES)), random.uniform(STARTED, whole)
            took, last = stopped(scan, number, after)
            seconds.append(took)
            print(f"{number.name} after {after:5.1f} of {whole:.0f} s: {took:4.1f} s; {last}")
    print(f"{stops} stops: longest {max(seconds):.1f} s")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2]))
