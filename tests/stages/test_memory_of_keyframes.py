"""Placing all others between key projections: memory grows with their number, not its square."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tomoslam_stage.products import Geometry
from tomoslam_stage.refinement import FactorGraph, Fused
from tomoslam_stage.scans import scan_of
from tomoslam_stage.stages.keyframes import Keyframes
from tomoslam_stage.stages.sources import Outcome

Needed = Callable[[Callable[[], object], int], float]

N, KEYS = 3000, 150


def test_placing_needs_a_small_part_of_a_matrix_of_all_angles(matrices: Needed) -> None:
    recorded = Geometry(np.linspace(0, 2 * np.pi, N, endpoint=False), axis=4.0)
    pixels = np.random.default_rng(0).random((N, 2, 8), np.float32)
    scan = scan_of(pixels, recorded.theta)
    keys = np.linspace(0, N - 1, KEYS).round().astype(np.intp)
    few = np.zeros(KEYS)
    known = Fused(
        geometry=Geometry(recorded.theta[keys], axis=4.0),
        variances=few + 1e-8,
        step_variances=few[1:] + 1e-8,
        halves=few[None],
        bias=few,
        residuals={},
    )
    keyframes = Keyframes(scan, recorded, keys, FactorGraph())
    outcome = Outcome(known, {})
    assert len(keyframes.completed(outcome).fused.sigma) == N
    assert matrices(lambda: keyframes.completed(outcome), N) < 0.2
