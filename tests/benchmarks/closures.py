"""How well loops are closed by the images alone: python tests/benchmarks/closures.py SCAN ...

For every scan, whose true angles must be known: how many projections were found again half a turn
or a full turn on, and by how much that is off, in degrees: median of the absolute value, rms, and
rms in units of the sigma that was told.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tomoslam_stage.angles import LoopClosure
from tomoslam_stage.geometry import rms
from tomoslam_stage.heldout import hold_out
from tomoslam_stage.products import Closures, Floats, Geometry
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.scans import open_scan, read_truth
from tomoslam_stage.stages.triplets import closed
from tomoslam_stage.stages.work import Clock


def missed(closures: Closures, theta: Floats) -> Floats:
    """(m,) radians by which closures miss the true angles `theta` (n,)."""
    seen, before, after = theta[closures.projections].T
    return seen - closures.turn - before - closures.share * (after - before)


def run() -> None:
    """Read the arguments, and print a line for each scan."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scans", nargs="+", type=Path)
    print(f"{'scan':24s} {'closed':>6s} {'median':>8s} {'rms':>8s} {'norm.':>6s}")
    for path in parser.parse_args().scans:
        scan, truth = open_scan(path), read_truth(path)
        assert truth is not None
        rows = hold_out(scan)
        axis = Reprojection().find_axis(scan.sinograms(rows.heldout), scan.theta)
        loops = closed(LoopClosure(), scan, rows, Geometry(scan.theta, axis), Clock({}))
        off = missed(loops, truth.theta)
        told = f"{np.median(np.abs(np.degrees(off))):8.4f} {np.degrees(rms(off)):8.4f}"
        print(f"{path.stem:24s} {len(loops):6d} {told} {rms(off / loops.sigma):6.2f}", flush=True)


if __name__ == "__main__":
    run()
