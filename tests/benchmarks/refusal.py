"""Scans whose recorded angles should stand, and some that should improve: what becomes of them.

    python tests/benchmarks/refusal.py [--cases NAME ...] [--seeds N ...]

For every scan: RMSE in degrees with the mean removed, recorded and refined, the verdict, and
whether it is the right one: ``worse`` is an accepted scan with worse angles, ``missed`` one that
should improve and was kept. Scans whose recorded angles are exact have ``still`` in their name.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from time import perf_counter
from typing import Any

import numpy as np

from tomoslam_stage import refine_theta
from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.products import Pixels, Refinement
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate

BASE = {"n_projections": 240, "rows": 96, "columns": 160, "axis_offset": 2.0}
WALK = {"angle_errors": [{"method": "walk", "sigma_deg": 0.05}]}
STILL: dict[str, Any] = {"angle_errors": []}
HALF = {"n_projections": 241, "span_deg": 180.0, "endpoint": True}
NOTHING = {"method": "grains", "grains": 1, "smallest": 1e-3, "largest": 1e-2}


def moving(name: str, **parameters: float) -> dict[str, Any]:
    """Let the sample move by itself."""
    return {"sample_motions": [{"method": name, **parameters}]}


def jitter(sigma_deg: float) -> dict[str, Any]:
    """Let every angle be wrong by itself."""
    return {"angle_errors": [{"method": "jitter", "sigma_deg": sigma_deg}]}


IMPROVE: Mapping[str, tuple[str, dict[str, Any]]] = {
    "grains": ("grains", {}),
    "grains-180": ("grains", HALF),
    "grains-walk-1": ("grains", {"angle_errors": [{"method": "walk", "sigma_deg": 1.0}]}),
    "foam": ("foam", {}),
    "foam-180": ("foam", HALF),
    "card": ("card", {"rows": 160, "columns": 240}),
}
"""Name -> phantom and what is special about a scan that should improve."""
STAND: Mapping[str, tuple[str, dict[str, Any]]] = {
    "smooth": ("smooth", {}),
    "empty": ("grains", {"phantom": NOTHING}),
    "few-12": ("grains", {"n_projections": 12}),
    "few-20": ("grains", {"n_projections": 20}),
    "outside": ("grains", {"cut": 80}),
    "still-outside": ("grains", {"cut": 64, **STILL}),
    "jitter-5": ("grains", jitter(5.0)),
    "jitter-5-card": ("card", jitter(5.0)),
    "shaking": ("grains", moving("shaking")),
    "still-shaking": ("grains", {**moving("shaking"), **STILL}),
    "drifting": ("grains", moving("drifting")),
    "drifting-card": ("card", moving("drifting")),
    "leaning": ("grains", moving("leaning", angle_deg=10)),
    "still-leaning": ("grains", {**moving("leaning"), **STILL}),
    "slipping": ("grains", moving("slipping")),
    "slipping-card": ("card", moving("slipping")),
    "swelling": ("grains", moving("swelling")),
    "swelling-180": ("grains", {**moving("swelling"), **HALF}),
    "swelling-card": ("card", moving("swelling")),
    "cone-400": ("grains", {"source_px": 400.0}),
    "cone-400-180": ("grains", {"source_px": 400.0, **HALF}),
    "cone-800-card": ("card", {"source_px": 800.0}),
    "cone-2000-card": ("card", {"source_px": 2000.0}),
    "still-cone-400-card": ("card", {"source_px": 400.0, **STILL}),
    "cone-300-foam": ("foam", {"source_px": 300.0}),
}
"""The same for scans that no choice of angles explains."""


def scanned(phantom: str, special: dict[str, Any], seed: int) -> tuple[SimulatedScan, Pixels]:
    """Simulate a scan: line integrals (n, row, column), of the last ``cut`` columns if asked."""
    recipe = {**BASE, **WALK, "phantom": {"method": phantom, "seed": seed}, "seed": seed, **special}
    cut = recipe.pop("cut", None)
    scan = simulate(recipe_from(recipe))
    white, dark = scan.whites.mean(axis=0), scan.darks.mean(axis=0)
    light = (np.stack(list(scan.projections())) - dark) / (white - dark)
    integrals = -np.log(np.maximum(light, 1e-3)).astype(np.float32)
    return scan, integrals if cut is None else integrals[..., -cut:]


def judged(scan: SimulatedScan, found: Refinement, *, improves: bool) -> tuple[str, str]:
    """Return errors and verdict, and what is wrong with the latter."""
    before, after = (
        float(np.degrees(rms_difference(theta, scan.theta_true)))
        for theta in (found.recorded, found.refined)
    )
    accepted = found.status == "accepted"
    wrong = "worse" if accepted and after > before else "missed" if improves > accepted else ""
    return f"{before:8.4f} {after:8.4f}  {found.status:8s}", wrong


def run() -> None:
    """Read the arguments, and print the table."""
    cases = {**IMPROVE, **STAND}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", nargs="*", default=list(cases), choices=cases)
    parser.add_argument("--seeds", nargs="*", type=int, default=(31,))
    args = parser.parse_args()
    print(f"{'case':20s} seed recorded  refined  verdict   wrong     s  reason")
    count = {"worse": 0, "missed": 0}
    for case in args.cases:
        for seed in args.seeds:
            scan, integrals = scanned(*cases[case], seed)
            begin = perf_counter()
            found = refine_theta(integrals, scan.theta_recorded)
            errors, wrong = judged(scan, found, improves=case in IMPROVE)
            count[wrong] = count.get(wrong, 0) + 1
            took = perf_counter() - begin
            print(
                f"{case:20s} {seed:4d} {errors} {wrong:6s} {took:4.0f}  {found.reason}", flush=True
            )
    print(f"{count['worse']} accepted and worse, {count['missed']} kept that should improve")


if __name__ == "__main__":
    run()
