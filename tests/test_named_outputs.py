"""A run writes what it was told to write, and nothing else anywhere."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl

MAKE = "--phantom smooth --projections 24 --rows 12 --columns 48 --seed 5 --error walk:0.2"
QUICK = ("--axis", "23.5", "--set", "refine_theta.mapping=null")


def called(*words: str | Path, cwd: Path, **places: Path) -> int:
    """Run the program elsewhere, with a home and a temporary folder of its own."""
    repository = Path(__file__).parents[1]
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(repository),
        "PYTHONDONTWRITEBYTECODE": "1",
        "MPLCONFIGDIR": mpl.get_configdir(),  # its list of fonts stays where it always is
        **{name: str(place) for name, place in places.items()},
    }
    program = [sys.executable, "-m", "tomoslam_stage", *map(str, words)]
    return subprocess.run(
        program, cwd=cwd, env=environment, capture_output=True, check=False
    ).returncode


def test_nothing_is_written_but_the_named_outputs(tmp_path: Path) -> None:
    places = {name: tmp_path / name for name in ("HOME", "TMPDIR", "here", "scans", "results")}
    for place in places.values():
        place.mkdir()
    here = places.pop("here")
    scan, results = places.pop("scans") / "scan.h5", places.pop("results")
    assert called("simulate", scan, *MAKE.split(), cwd=here, **places) == 0
    assert list(tmp_path.rglob("*.*")) == [scan]
    words = (scan, *QUICK, "--output", results / "refined.h5", "--log", results / "log.txt")
    assert called(*words, "--report", results / "report", cwd=here, **places) == 4
    written = {path.parent for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {scan.parent, results, results / "report"}
    assert [path.name for path in results.iterdir() if path.is_file()] == ["log.txt"]
    assert called("inspect", scan, cwd=here, **places) == 0
    assert called("revert", scan, cwd=here, **places) == 3
    assert {path.parent for path in tmp_path.rglob("*") if path.is_file()} == written
    assert list(scan.parent.iterdir()) == [scan]
