"""How long the default run takes, and how much memory: simulated grains in a process of their own.

    python tests/benchmarks/whole_run.py          360 projections of 256 x 320 px
    python tests/benchmarks/whole_run.py large    1800 projections of 1024 x 1024 px

The large scan repeats 128 simulated rows eight times, which is quicker to make; its angles mean
nothing. It takes 3 GB of disk, and about fifteen minutes of two cores to make and to run.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.scans import ScanContent, create_scan
from tomoslam_stage.simulation import recipe_from, simulate

SIZES = {
    "small": {"n_projections": 360, "rows": 256, "columns": 320, "repeats": 1},
    "large": {"n_projections": 1800, "rows": 128, "columns": 1024, "repeats": 8},
}


def make(path: Path, n_projections: int, rows: int, columns: int, repeats: int) -> None:
    """Simulate grains with an encoder walk, and write them as a scan."""
    shape = {"n_projections": n_projections, "rows": rows, "columns": columns}
    phantom = {"method": "grains", "seed": 1020}
    made = simulate(recipe_from({"phantom": phantom, "seed": 1020, **shape}))

    def repeated(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
        return np.tile(image, (repeats, 1))

    content = ScanContent(
        projections=map(repeated, made.projections()),
        flats=np.stack([repeated(image) for image in made.whites]),
        darks=np.stack([repeated(image) for image in made.darks]),
        theta_deg=np.degrees(made.theta_recorded),
    )
    create_scan(path, content)


def timed(path: Path) -> tuple[float, float]:
    """Return the seconds of a default run and its peak memory in MB."""
    command = [sys.executable, "-m", "tomoslam_stage", str(path), "--dry-run"]
    begin = perf_counter()
    subprocess.run(command, check=False, capture_output=True)
    seconds = perf_counter() - begin
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1000


if __name__ == "__main__":
    size = sys.argv[1] if len(sys.argv) > 1 else "small"
    with tempfile.TemporaryDirectory() as folder:
        scan = Path(folder) / "scan.h5"
        make(scan, **SIZES[size])
        took, memory = timed(scan)
    print(f"{size}: {took:.0f} s, {memory:.0f} MB at most")
