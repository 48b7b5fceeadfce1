"""The paper's error ratio on simulated scans, for every seed and pooled.

    python tests/benchmarks/error_ratio.py [PIPELINE] [PHANTOM ...]

360 projections of 256 x 320 px over 360 degrees, an encoder walk of 0.05 degrees a step. Seeds and
phantoms are others than those the parameters were chosen on. The ratio is that of the paper's
equation 7, first angle fixed; pooled: rms recorded error over rms refined error of all seeds. The
refined angles are counted as they were found; "stands" is what the gate made of them.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from tomoslam_stage.cli import main
from tomoslam_stage.comparison.metrics import errors_against
from tomoslam_stage.geometry import rms
from tomoslam_stage.pipeline import check, load_pipeline
from tomoslam_stage.scans import open_scan, read_truth
from tomoslam_stage.stages import STAGES
from tomoslam_stage.stages.refining import RefineTheta
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
    """Make the scan of one seed; the axis lies some px beside the middle."""
    path = folder / f"{phantom}_{seed}.h5"
    options = f"--phantom {phantom} --seed {seed} --error walk:0.05"
    options += f" --set axis_offset={seed % 7 - 3} --set phantom.seed={seed}"
    main(["simulate", str(path), *options.split()])
    return path


def measured(path: Path, pipeline: str) -> Result:
    """Refine one scan, and score what was found."""
    stages = check(load_pipeline(pipeline), STAGES)
    refine = next(stage for stage in stages if isinstance(stage, RefineTheta))
    scan, truth = open_scan(path), read_truth(path)
    assert truth is not None
    begin = perf_counter()
    found = refine.refine(scan, Clock({}))
    errors = errors_against(truth, found)
    return Result(
        recorded=errors["recorded_rms_first_fixed_deg"],
        refined=errors["refined_rms_first_fixed_deg"],
        recorded_free=errors["recorded_rms_deg"],
        refined_free=errors["refined_rms_deg"],
        sigma=float(np.rad2deg(np.median(found.sigma))),
        status=found.status,
        seconds=perf_counter() - begin,
    )


def table(pipeline: str, phantom: str) -> None:
    """Print a line for each seed, then what all of them come to."""
    print(f"\n{phantom}, pipeline {pipeline}: degrees")
    print(
        "seed   first angle fixed: recorded refined ratio"
        "   mean removed: recorded refined   sigma  stands     s"
    )
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in SEEDS:
            r = measured(simulated(Path(folder), phantom, seed), pipeline)
            results.append(r)
            print(
                f"{seed}   {r.recorded:26.3f} {r.refined:7.3f} {r.recorded / r.refined:5.2f}"
                f"   {r.recorded_free:22.3f} {r.refined_free:7.3f}"
                f"   {r.sigma:.3f}  {r.status:8s} {r.seconds:4.0f}",
                flush=True,
            )
    recorded = rms(np.array([r.recorded for r in results]))
    refined = rms(np.array([r.refined for r in results]))
    accepted = sum(r.status == "accepted" for r in results)
    worse = sum(r.status == "accepted" and r.refined_free > r.recorded_free for r in results)
    print(
        f"pooled ratio {recorded / refined:.2f}; {accepted} of {len(results)} accepted, "
        f"{worse} of them worse than recorded"
    )


if __name__ == "__main__":
    chosen = sys.argv[1] if len(sys.argv) > 1 else "default"
    for name in sys.argv[2:] or PHANTOMS:
        table(chosen, name)
