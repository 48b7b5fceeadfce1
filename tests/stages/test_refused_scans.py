"""Scans that no choice of angles explains; more of them are in benchmarks/refusal.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tomoslam_stage import refine_theta
from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.products import Pixels
from tomoslam_stage.refinement.gate import Gate
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate

Scanned = Callable[[dict[str, Any]], tuple[SimulatedScan, Pixels]]

SMALL: dict[str, Any] = {
    "phantom": {"method": "grains", "grains": 300, "seed": 9},
    "n_projections": 90,
    "rows": 64,
    "columns": 96,
    "angle_errors": [{"method": "walk", "sigma_deg": 0.05}],
    "seed": 9,
}
CASES: dict[str, dict[str, Any]] = {
    "too few": {"n_projections": 12},
    "jitter": {"angle_errors": [{"method": "jitter", "sigma_deg": 5.0}]},
    "shaking": {"sample_motions": [{"method": "shaking", "sigma_px": 3.0}]},
    "slipping": {"sample_motions": [{"method": "slipping", "angle_deg": 10.0}]},
    "drifting": {"sample_motions": [{"method": "drifting", "x_px": 8.0}], "angle_errors": []},
}


BOARD = {
    "phantom": {"method": "card", "seed": 9},
    "n_projections": 120,
    "rows": 96,
    "columns": 128,
}
HALF = {"n_projections": 121, "span_deg": 180.0, "endpoint": True}


@pytest.fixture
def scanned(flat_fielded: Callable[[SimulatedScan], Pixels]) -> Scanned:
    """Simulate a scan: line integrals (n, row, column)."""

    def made(special: dict[str, Any]) -> tuple[SimulatedScan, Pixels]:
        scan = simulate(recipe_from(SMALL | special))
        return scan, flat_fielded(scan)

    return made


@pytest.mark.parametrize("case", CASES)
def test_recorded_angles_stand_with_a_reason_in_numbers(case: str, scanned: Scanned) -> None:
    scan, integrals = scanned(CASES[case])
    found = refine_theta(integrals, scan.theta_recorded)
    assert found.status == "kept"
    assert found.theta is found.recorded
    assert any(letter.isdigit() for letter in found.reason)


def test_a_board_that_shrinks_is_given_away_by_rows_of_features_and_by_little_else(
    scanned: Scanned,
) -> None:
    scan, integrals = scanned(BOARD | {"sample_motions": [{"method": "swelling"}]})
    found = refine_theta(integrals, scan.theta_recorded, mapping=None)
    recorded, refined = (
        rms_difference(theta, scan.theta_true) for theta in (found.recorded, found.refined)
    )
    assert refined > 3 * recorded
    assert found.evidence is not None
    # Halves agree, unused rows reproject better, and sigma is a third of what is put right.
    careless = Gate(most_moved=100.0)
    assert careless.judge(found.evidence).status == "accepted"
    assert found.status == "kept"
    assert "the sample moves by itself or changes its size" in found.reason


def test_a_beam_that_spreads_is_named(scanned: Scanned) -> None:
    scan, integrals = scanned(HALF | {"source_px": 400.0})
    found = refine_theta(integrals, scan.theta_recorded, mapping=None)
    assert found.status == "kept"
    assert "the beam is not parallel" in found.reason
    assert "the sample moves" not in found.reason


def test_a_sound_scan_has_neither_said_of_it(scanned: Scanned) -> None:
    scan, integrals = scanned(HALF)
    found = refine_theta(integrals, scan.theta_recorded, mapping=None)
    assert found.evidence is not None
    assert found.evidence.rigidity is not None
    assert found.evidence.rigidity.features > 300
    assert "rows of features" not in found.reason
