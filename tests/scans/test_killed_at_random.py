"""A real process is killed while it writes; ``tests/benchmarks/kills.py`` does this 400 times."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from killing import WAYS, killed, make_scan, write_once


@pytest.mark.parametrize("way", WAYS)
def test_killed_at_random_instants_the_scan_is_all_old_or_all_new(tmp_path: Path, way: str) -> None:
    path = tmp_path / "scan.h5"
    make_scan(path)
    longest, random = 4 * write_once(path, way, 1), Random(7)
    found = [killed(path, way, random, longest) for _ in range(20)]
    assert found[-1].number > 1 or any(each.recovered for each in found)
