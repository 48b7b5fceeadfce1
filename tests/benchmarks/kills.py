"""Kill a process that writes angles at random instants, many times, with both ways of writing.

``python tests/benchmarks/kills.py [KILLS] [FOLDER]``: each way is killed KILLS times (200) in a new
folder under FOLDER (the system's for temporary files). After each kill the scan must be all old or
all new, every other dataset unchanged, nothing left beside it. While a copy is edited, another
process opens the scan with plain h5py without a pause, and tells how often it could not.
"""

from __future__ import annotations

import logging
import multiprocessing
import sys
import tempfile
from collections import Counter
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "scans"))

from killing import WAYS, killed, make_scan, state, write_once


def read_on(path: Path, stop: Any, said: Any) -> None:
    """Open and check the scan until told to stop; say how often, and how often it was locked."""
    opened = locked = 0
    while not stop.is_set():
        try:
            state(path)
            opened += 1
        except BlockingIOError:
            locked += 1
    said.put((opened, locked))


def way_killed(way: str, kills: int, folder: Path) -> str:
    """Kill one way of writing `kills` times, and say in a line what was found."""
    path = folder / "scan.h5"
    make_scan(path, n=360, rows=32, columns=64)
    context = multiprocessing.get_context("fork")
    stop, said = context.Event(), context.Queue()
    reader = context.Process(target=read_on, args=(path, stop, said))
    if way == "copy":
        reader.start()
    begin, random = perf_counter(), Random(11)
    longest = 4 * write_once(path, way, 1)
    found = [killed(path, way, random, longest) for _ in range(kills)]
    left = Counter(name.rsplit(".", 1)[1] for each in found for name in each.left)
    line = (
        f"{way}: {kills} kills in {perf_counter() - begin:.0f} s, all old or all new; "
        f"{found[-1].number} writes were finished, {sum(each.recovered for each in found)} kills "
        f"left something to recover: {dict(left)}"
    )
    if way == "copy":
        stop.set()
        opened, locked = said.get(timeout=60)
        reader.join()
        line += f"; opened by plain h5py {opened} times meanwhile, refused by the lock {locked}"
    return line


def main(kills: int = 200, folder: str | None = None) -> None:
    """Kill both ways and print what was found."""
    for way in WAYS:
        with tempfile.TemporaryDirectory(dir=folder) as place:
            print(way_killed(way, kills, Path(place)))


if __name__ == "__main__":
    logging.disable()  # each recovery says so
    words = sys.argv[1:]
    main(*(int(word) for word in words[:1]), *words[1:2])
