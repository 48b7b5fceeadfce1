from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random

import h5py
from spoiling import outcome, spoiled


def test_a_spoiled_file_is_read_or_refused_and_left_alone(tmp_path: Path, scan_file: Path) -> None:
    with h5py.File(scan_file, "r+") as file:
        file["/measurement/instrument/detector/x_pixel_size"] = 1e-6
        file["/exchange/theta"].attrs["encoder"] = "ring 3"
    sound, random, codes = scan_file.read_bytes(), Random(6), Counter()
    path = tmp_path / "spoiled.h5"
    for _ in range(30):
        content = spoiled(sound, random)
        path.write_bytes(content)
        codes[outcome(path)] += 1
        assert path.read_bytes() == content
    assert set(codes) == {0, 3}
