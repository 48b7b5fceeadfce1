"""How long the linear factor graph takes to build and to solve.

    python tests/benchmarks/graph_timing.py

The paper: 0.053 s for 360 angles on twelve cores. Median of eleven runs, after one that warms up.
"""

from __future__ import annotations

from statistics import median
from time import perf_counter

import numpy as np

from tomoslam_stage.products import AngleMeasurements, Floats
from tomoslam_stage.refinement.factors import FACTORS
from tomoslam_stage.refinement.graph import linear_graph, solve_once

RUNS = 11


def measurements(theta: Floats, steps: tuple[int, ...], sigma: float) -> AngleMeasurements:
    """Make noisy triplets of every projection, around the full turn."""
    here = np.arange(len(theta))
    projections = np.concatenate(
        [np.stack([here, here + step, here + 2 * step], axis=1) % len(theta) for step in steps]
    )
    noise = np.random.default_rng(0).normal(0, sigma, (len(projections), 2))
    covariance = np.tile(sigma**2 * np.eye(2), (len(projections), 1, 1))
    none = np.zeros(len(projections), np.intp)
    measured = np.diff(theta[projections], axis=1) + noise
    return AngleMeasurements(projections, measured, covariance, none, none)


def timed(count: int, steps_deg: tuple[float, ...]) -> tuple[float, float]:
    """Return the median seconds to build and to solve."""
    theta = np.linspace(0, 2 * np.pi, count, endpoint=False)
    steps = tuple(round(step * count / 360) for step in steps_deg)
    found = measurements(theta, steps, np.deg2rad(0.1))
    blocks = {name: factor().block(theta, found) for name, factor in FACTORS.items()}
    weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
    builds, solves = [], []
    for _ in range(RUNS + 1):
        begin = perf_counter()
        graph = linear_graph(blocks, weights, theta)
        built = perf_counter()
        solve_once(graph, count)
        builds.append(built - begin)
        solves.append(perf_counter() - built)
    return median(builds[1:]), median(solves[1:])


if __name__ == "__main__":
    print("angles  CV steps / deg    build / ms  solve / ms  together / ms")
    for angles in (360, 1800, 10000):
        for chosen in ((10.0,), (4.0, 5.0, 10.0), (4.0, 5.0, 10.0, 20.0)):
            build, solve = timed(angles, chosen)
            told = ", ".join(f"{step:g}" for step in chosen)
            times = f"{1e3 * build:11.1f} {1e3 * solve:11.1f} {1e3 * (build + solve):14.1f}"
            print(f"{angles:6d}  {told:16s} {times}")
