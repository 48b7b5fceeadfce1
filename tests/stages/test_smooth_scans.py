"""Scans in which nothing fine is seen: no source may talk the gate into anything."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tomoslam_stage import refine_theta
from tomoslam_stage.products import Pixels
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate

WALK = [{"method": "walk", "sigma_deg": 0.2}]


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
@pytest.mark.parametrize("angle_errors", [[], WALK], ids=["right", "walk"])
def test_a_smooth_scan_keeps_its_recorded_angles(
    seed: int, angle_errors: list[dict[str, Any]], flat_fielded: Callable[[SimulatedScan], Pixels]
) -> None:
    scan = simulate(
        recipe_from(
            {
                "phantom": {"method": "smooth", "seed": seed},
                "angle_errors": angle_errors,
                "n_projections": 60,
                "rows": 96,
                "columns": 128,
                "axis_offset": 2.0,
                "seed": seed,
            }
        )
    )
    found = refine_theta(flat_fielded(scan), scan.theta_recorded)
    assert found.status == "kept"
    assert found.theta is found.recorded
