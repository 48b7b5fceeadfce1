"""The paper's error ratio on simulated scans, for every seed and pooled.

    python tests/benchmarks/error_ratio.py [PIPELINE] [PHANTOM ...]

360 projections of 256 x 320 px over 360 degrees, an encoder walk of 0.05 degrees a step. Seeds and
phantoms are others than those used while developing. The ratio is that of the paper's equation 7,
first angle fixed; pooled: rms recorded error over rms refined error of all seeds. The refined
angles are counted as they were found; "stands" is what the gate made of them.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from tomoslam_stage.cli import main
from tomoslam_stage.geometry import rms, rms_difference
from tomoslam_stage.methods import checked
from tomoslam_stage.pipeline import check, load_pipeline
from tomoslam_stage.scans import open_scan, read_truth
from tomoslam_stage.stages import STAGES
from tomoslam_stage.stages.work import Clock

SEEDS = (1011, 1012, 1013, 1014, 1015)
PHANTOMS = ("card", "grains")


@dataclass(frozen=True)
class Result:
    """Errors in degrees with the first angle fixed, and with the mean removed."""

    recorded: float
    refined: float
    recorded_free: float
    refined_free: float
    sigma: float
    status: str
    seconds: float


def simulated(folder: Path, phantom: str, seed: int) -> Path:
    path = folder / f"{phantom}_{seed}.h5"
    options = f"--phantom {phantom} --seed {seed} --error walk:0.05 --set axis_offset={seed % 7 - 3}"
    main(["simulate", str(path), *options.split(), "--set", f"phantom.seed={seed}"])
    return path


def measured(path: Path, pipeline: str) -> Result:
    stages = check(load_pipeline(pipeline), STAGES)
    refine = next(stage for stage in stages if type(stage) is STAGES["refine_theta"])
    scan, truth = open_scan(path), read_truth(path)
    begin = perf_counter()
    found = refine.refine(scan, Clock({}))
    first = [theta - theta[0] - (truth.theta - truth.theta[0]) for theta in (found.recorded, found.refined)]
    return Result(
        *(float(np.rad2deg(rms(error))) for error in first),
        *(float(np.rad2deg(rms_difference(theta, truth.theta))) for theta in (found.recorded, found.refined)),
        sigma=float(np.rad2deg(np.median(found.sigma))),
        status=found.status,
        seconds=perf_counter() - begin,
    )


def table(pipeline: str, phantom: str) -> None:
    print(f"\n{phantom}, pipeline {pipeline}: degrees")
    print("seed   first angle fixed: recorded refined ratio   mean removed: recorded refined   sigma  stands     s")
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in SEEDS:
            r = measured(simulated(Path(folder), phantom, seed), pipeline)
            results.append(r)
            print(
                f"{seed}   {r.recorded:26.3f} {r.refined:7.3f} {r.recorded / r.refined:5.2f}"
                f"   {r.recorded_free:22.3f} {r.refined_free:7.3f}   {r.sigma:.3f}  {r.status:8s} {r.seconds:4.0f}",
                flush=True,
            )
    recorded, refined = (rms(np.array([getattr(r, k) for r in results])) for k in ("recorded", "refined"))
    accepted = sum(r.status == "accepted" for r in results)
    worse = sum(r.status == "accepted" and r.refined_free > r.recorded_free for r in results)
    print(f"pooled ratio {recorded / refined:.2f}; {accepted} of {len(results)} accepted, {worse} of them worse than recorded")


if __name__ == "__main__":
    chosen = sys.argv[1] if len(sys.argv) > 1 else "default"
    for name in sys.argv[2:] or PHANTOMS:
        table(chosen, name)
