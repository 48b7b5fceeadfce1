"""A made-up scan, refined and reconstructed, with one detail that the new angles move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.comparison import Findings, Run, compare
from tomoslam_stage.products import (
    UNKNOWNS,
    Evidence,
    Floats,
    Integers,
    Pixels,
    Reconstruction,
    Reconstructions,
    Refinement,
    Scan,
    Truth,
)

SIDE = 80
PROJECTIONS = 90
DETAIL = (30, 52)
"""z, x of the detail that differs between recorded and refined."""


class FrugalSource:
    """Projections of one bright column; to read many at once would be a mistake."""

    def __init__(self, projections: int = PROJECTIONS, rows: int = 16, columns: int = SIDE) -> None:
        self.shape = (projections, rows, columns)

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        assert len(projections) == 1 or len(rows) == 1
        made = np.zeros((len(projections), len(rows), self.shape[2]), np.float32)
        made[..., self.shape[2] // 3] = 1
        return made


def a_slice(z: float, x: float) -> Pixels:
    """Draw a disc with a bright detail at (z, x)."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    image = 0.01 * (np.hypot(rows - 39.5, columns - 39.5) < 34)
    image += 0.02 * (np.hypot(rows - z, columns - x) < 4)
    return np.asarray(image, np.float32)


def the_reconstruction(theta: Floats, x: float) -> Reconstruction:
    z = DETAIL[0]
    slices = np.stack([a_slice(z, DETAIL[1]), a_slice(z, x), a_slice(z, DETAIL[1])])
    return Reconstruction(theta, 39.5, np.array([2, 7, 11]), slices, "embedded fbp")


@pytest.fixture
def truth() -> Truth:
    return Truth(np.arange(PROJECTIONS) * np.radians(2.0))


@pytest.fixture
def refinement(truth: Truth) -> Refinement:
    rng = np.random.default_rng(5)
    recorded = truth.theta + np.radians(np.cumsum(rng.normal(0, 0.05, PROJECTIONS)))
    refined = truth.theta + np.radians(rng.normal(0, 0.01, PROJECTIONS))
    return Refinement(
        recorded,
        refined,
        np.full(PROJECTIONS, np.radians(0.02)),
        "accepted",
        "two halves agree to 0.01 deg; the recorded angles are off by 0.2 deg",
        {"recorded": 38.5, "refined": 39.25},
        Evidence(
            half_error_deg=0.01,
            recorded_error_deg=0.2,
            half_measured=0.8,
            residual_recorded=0.05,
            residual_refined=0.04,
            residual_gain_sigma=7.5,
        ),
        counts={"features": 321, "sightings": 4321},
        reprojection={
            "recorded": np.full(PROJECTIONS, 0.05),
            "refined": np.full(PROJECTIONS, 0.04),
        },
        heldout_rows=np.array([3, 8]),
    )


@pytest.fixture
def kept(refinement: Refinement) -> Refinement:
    return replace(refinement, status="kept", reason="the halves disagree by 0.6 deg")


@pytest.fixture
def reconstructions(refinement: Refinement) -> Reconstructions:
    return {
        "recorded": the_reconstruction(refinement.recorded, DETAIL[1] + 2),
        "refined": the_reconstruction(refinement.refined, DETAIL[1]),
    }


@pytest.fixture
def findings(refinement: Refinement, reconstructions: Reconstructions) -> Findings:
    scan = Scan(FrugalSource(), refinement.recorded, np.arange(PROJECTIONS), name="a$b$.h5")
    comparison = compare(refinement, reconstructions)
    return Findings(scan, refinement, reconstructions, comparison)


@pytest.fixture
def with_truth(findings: Findings, truth: Truth) -> Findings:
    comparison = compare(findings.refinement, findings.reconstructions, truth)
    return replace(findings, comparison=comparison, truth=truth)


@pytest.fixture
def complete(findings: Findings, truth: Truth) -> Findings:
    """All there can be: slices of the true angles, too, halves of the middle one, convergence."""
    made = dict(findings.reconstructions)
    rng = np.random.default_rng(3)
    made["true"] = the_reconstruction(truth.theta, DETAIL[1])
    noise = rng.normal(0, 1e-4, made["true"].slices.shape).astype(np.float32)
    made["true"] = replace(made["true"], slices=made["true"].slices + noise)
    for name in ("recorded", "refined", "true"):
        whole = made[name]
        made[name] = replace(whole, convergence=0.2 / np.arange(1, 31))
        for ending in ("_even", "_odd"):
            noise = rng.normal(0, 0.003, (1, SIDE, SIDE)).astype(np.float32)
            made[name + ending] = replace(
                whole, rows=whole.rows[1:2], slices=whole.slices[1:2] + noise
            )
    comparison = compare(findings.refinement, made, truth)
    return replace(findings, reconstructions=made, comparison=comparison, truth=truth)


@pytest.fixture
def moved(complete: Findings) -> Findings:
    """A sample that moved on its stage; all of the true shifts lie 2 px farther to the right."""
    shift = np.random.default_rng(7).normal(0, 0.5, PROJECTIONS)
    refinement = replace(
        complete.refinement,
        shift=shift,
        shift_sigma=np.full(PROJECTIONS, 0.03),
        unknowns=UNKNOWNS,
    )
    truth = Truth(refinement.refined, shift=shift + 2)
    return replace(complete, refinement=refinement, truth=truth)


@pytest.fixture
def run() -> Run:
    entry = {"method": "refine_theta", "parameters": {"steps_deg": np.array([4, 5, 10])}}
    return Run({"load_scan": 1.25, "refine_theta": 30.5}, [entry])


@pytest.fixture
def kept_findings(findings: Findings, kept: Refinement) -> Findings:
    return replace(findings, refinement=kept)


@pytest.fixture
def tiny() -> Callable[[int], Findings]:
    """Make findings of a scan of so many projections that nothing was found in."""

    def made(projections: int) -> Findings:
        theta = np.arange(projections, dtype=float)
        unknown = np.full(projections, np.nan)
        axes = dict.fromkeys(("recorded", "refined"), float("nan"))
        refinement = Refinement(theta, theta, unknown, "kept", "no keypoints", axes)
        source = FrugalSource(projections, 1, 3)
        made = Reconstruction(theta, 1.0, np.array([0]), np.zeros((1, 3, 3), np.float32), "none")
        both = {"recorded": made, "refined": made}
        scan = Scan(source, theta, np.arange(projections))
        return Findings(scan, refinement, both, compare(refinement, both))

    return made
