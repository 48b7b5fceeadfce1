"""How accurate the refined angles are, on many kinds of scans, beside the obvious alternatives.

    python tests/benchmarks/accuracy.py [--cases NAME ...] [--methods NAME ...] [--seeds N ...]
        [--scans FOLDER] [--keep FOLDER]

For every scan: RMSE in degrees with the mean removed, recorded and refined, the sigma that was told
(rms), the normalised error (rms of error over sigma), the verdict, the seconds, and the lapses of
the stage that were named. Then, pooled over the seeds, the ratio of the paper's equation 7 (first
angle fixed). ``--scans`` names a folder with scans of real objects whose true angles are known;
``--keep`` keeps simulated scans for the next time.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from tomoslam_stage.cli import main
from tomoslam_stage.comparison.metrics import difference_of_angles
from tomoslam_stage.geometry import rms
from tomoslam_stage.methods import checked
from tomoslam_stage.scans import open_scan, read_truth
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Clock

WALK = "--error walk:0.05"
LARGE = "--set rows=512 --set columns=640"
MOVING = "--set shift_px=0.5"
HALF = "--projections 361 --span 180 --set endpoint=true"
CASES: Mapping[str, str] = {
    "card": f"--phantom card {WALK}",
    "grains": f"--phantom grains {WALK}",
    "foam": f"--phantom foam {WALK}",
    "grains-180-roll": f"--phantom grains {WALK} {HALF} --set roll_deg=0.1",
    "grains-jitter": "--phantom grains --error jitter:0.1",
    "grains-lost": f"--phantom grains {WALK} --error lost_step:1.5",
    "grains-eccentric": "--phantom grains --error eccentric:0.3",
    "card-jitter": "--phantom card --error jitter:0.1",
    "card-lost": f"--phantom card {WALK} --error lost_step:1.5",
    "card-512": f"--phantom card {WALK} {LARGE}",
    "card-moving": f"--phantom card {WALK} {MOVING}",
    "grains-moving": f"--phantom grains {WALK} {MOVING}",
    "foam-moving": f"--phantom foam {WALK} {MOVING}",
    "grains-512": f"--phantom grains {WALK} {LARGE}",
}
"""Name -> how `simulate` makes it; 360 projections of 256 x 320 px over 360 degrees unless said."""
METHODS: Mapping[str, Mapping[str, Any]] = {
    "paper": {"angles": {}, "landmarks": None, "mapping": None},
    "features": {"mapping": None},
    "map": {"landmarks": None},
    "default": {},
    "shift": {"unknowns": ["theta", "axis", "roll", "shift"]},
    "closures": {"closures": {}},
}
"""Name -> parameters of refine_theta."""
COMPARED = ("paper", "features", "map", "default")
SEEDS = (4101, 4102, 4103, 4104, 4105)
"""Other than those that served development; where one has, measure with others, too."""


@dataclass(frozen=True)
class Result:
    """One scan by one method; degrees."""

    recorded: float
    refined: float
    first_fixed: tuple[float, float]
    """Recorded and refined, rms with the first angle fixed."""
    sigma: float
    normalised: float
    status: str
    seconds: float
    events: str
    """Each lapse of the stage that was named, and how large the error of that step truly was."""


def simulated(folder: Path, case: str, seed: int) -> Path:
    """Make the scan of one seed, unless it is there; the axis lies some px beside the middle."""
    path = folder / f"{case}_{seed}.h5"
    if not path.exists():
        options = f"--seed {seed} --set axis_offset={seed % 19 - 9} --set phantom.seed={seed}"
        main(["simulate", str(path), *CASES[case].split(), *options.split()])
    return path


def measured(path: Path, method: str) -> Result:
    """Refine one scan, and score what was found."""
    scan, truth = open_scan(path), read_truth(path)
    assert truth is not None
    begin = perf_counter()
    stage = checked(RefineTheta, METHODS[method], "refine_theta")
    found = stage.refine(scan, Clock({}))
    took = perf_counter() - begin
    before, after = (
        np.degrees(difference_of_angles(theta, truth.theta))
        for theta in (found.recorded, found.refined)
    )
    off, sigma = after - after.mean(), np.degrees(found.sigma)
    true = np.diff(-before)
    lapses = [
        f"{event.kind} {event.projection}: {event.size_deg:+.3f}, truly "
        f"{true[event.projection - 1]:+.3f}"
        for event in found.events
    ]
    return Result(
        recorded=float(before.std()),
        refined=float(after.std()),
        first_fixed=(rms(before - before[0]), rms(after - after[0])),
        sigma=rms(sigma),
        normalised=rms(off / np.where(sigma > 0, sigma, np.nan)),
        status=found.status,
        seconds=took,
        events="; ".join(lapses),
    )


def shown(case: str, method: str, name: str, r: Result) -> str:
    """Return a line of the table."""
    return (
        f"{case:16s} {method:9s} {name:16s} {r.recorded:8.4f} {r.refined:8.4f} {r.sigma:8.4f} "
        f"{r.normalised:6.2f}  {r.status:8s} {r.seconds:4.0f}  {r.events}".rstrip()
    )


def pooled(case: str, method: str, results: list[Result]) -> str:
    """Return what all seeds come to."""
    before, after = (rms(np.array([r.first_fixed[k] for r in results])) for k in (0, 1))
    accepted = [r for r in results if r.status == "accepted"]
    worse = sum(r.refined > r.recorded for r in accepted)
    refined = [r.refined for r in results]
    return (
        f"{case:16s} {method:9s} worst {max(refined):.4f} median {np.median(refined):.4f} "
        f"ratio {before / after:.1f}; {len(accepted)} of {len(results)} accepted, {worse} worse"
    )


def table(case: str, paths: list[Path], methods: list[str]) -> None:
    """Print all lines of one case."""
    for method in methods:
        results = []
        for path in paths:
            results.append(measured(path, method))
            print(shown(case, method, path.stem[-16:], results[-1]), flush=True)
        print(pooled(case, method, results), flush=True)


def run() -> None:
    """Read the arguments, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=CASES)
    parser.add_argument("--methods", nargs="*", default=COMPARED, choices=METHODS)
    parser.add_argument("--seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--scans", type=Path)
    parser.add_argument("--keep", type=Path)
    args = parser.parse_args()
    head = "recorded  refined    sigma  norm.  verdict    s"
    print(f"{'case':16s} {'method':9s} {'scan':16s} {head}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for case in args.cases:
            table(case, [simulated(folder, case, seed) for seed in args.seeds], args.methods)
    for path in sorted(args.scans.glob("*.h5")) if args.scans else ():
        if read_truth(path) is not None:
            table("real", [path], args.methods)


if __name__ == "__main__":
    run()
