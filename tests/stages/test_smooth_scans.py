"""Scans in which nothing fine is seen: no source may talk the gate into anything."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tomoslam_stage import refine_theta
from tomoslam_stage.simulation import recipe_from, simulate

WALK = [{"method": "walk", "sigma_deg": 0.2}]


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
@pytest.mark.parametrize("angle_errors", [[], WALK], ids=["right", "walk"])
def test_a_smooth_scan_keeps_its_recorded_angles(
    seed: int, angle_errors: list[dict[str, Any]]
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
    white, dark = scan.whites.mean(axis=0), scan.darks.mean(axis=0)
    transmission = (np.stack(list(scan.projections())) - dark) / (white - dark)
    found = refine_theta(-np.log(np.maximum(transmission, 1e-3)), scan.theta_recorded)
    assert found.status == "kept"
    assert found.theta is found.recorded
