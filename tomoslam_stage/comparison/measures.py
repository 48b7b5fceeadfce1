"""The numbers that compare recorded with refined angles, in words that need no other reading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from tomoslam_stage.comparison.findings import residual_change, rows_word

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.comparison.findings import Findings


@dataclass(frozen=True)
class Measure:
    """One line of the table."""

    name: str
    unit: str
    values: Mapping[str, float]
    """Name of the angles -> value; nan where it is not known."""
    better: Literal["less", "more"]
    decides: bool
    """Whether the verdict rests on it; all else describes."""
    note: str
    """What it means, and what it does not."""


def measures(findings: Findings) -> list[Measure]:
    """All that is known of a run, what decides first."""
    made = [*_deciding(findings), *_from_truth(findings), *_of_slices(findings)]
    if not findings.refinement.change.any():
        made = [replace(measure, values=_without_refined(measure.values)) for measure in made]
    return [measure for measure in made if np.isfinite(list(measure.values.values())).any()]


def _without_refined(values: Mapping[str, float]) -> dict[str, float]:
    """Leave out what is no second set of angles."""
    return {name: value for name, value in values.items() if name != "refined"}


def _deciding(findings: Findings) -> list[Measure]:
    refinement = findings.refinement
    residual, evidence = residual_change(refinement), refinement.evidence
    where = rows_word(refinement.heldout_rows)
    residuals = {"recorded": residual.recorded, "refined": residual.refined}
    note = "What a reconstruction cannot explain of rows that took no part in the refinement."
    if not len(refinement.heldout_rows):
        note = "What a reconstruction cannot explain of the projections it was made from."
    made = [Measure(f"residual on {where}", "line integral", residuals, "less", True, note)]
    if evidence is not None:
        errors = {"recorded": evidence.recorded_error_deg, "refined": evidence.half_error_deg}
        note = "Error of the angles as two halves of the data show it that share nothing."
        made.append(Measure("error told by halves", "deg", errors, "less", True, note))
    return made


def _from_truth(findings: Findings) -> list[Measure]:
    errors, similarity = findings.comparison.errors, findings.comparison.similarity
    nothing: dict[str, float] = {}
    angles = {n: errors[f"{n}_rms_deg"] for n in ("recorded", "refined")} if errors else nothing
    note = "Against the angles the scan was simulated with, mean removed; nothing else saw them."
    made = [Measure("true error of the angles, rms", "deg", angles, "less", False, note)]
    for name, unit, key, note in (
        ("PSNR", "dB", "psnr", "Likeness to the slices from the true angles, by squared error."),
        (
            "SSIM",
            "",
            "ssim",
            "Likeness to the slices from the true angles, by structure; 1 is equal.",
        ),
    ):
        made.append(Measure(name, unit, similarity.get(key, nothing), "more", False, note))
    return made


def _of_slices(findings: Findings) -> list[Measure]:
    facts, sharpness = findings.comparison, findings.comparison.sharpness
    nothing: dict[str, float] = {}
    made = [
        Measure(
            "width of the most changed edge",
            "px",
            facts.edge_width_px,
            "less",
            False,
            "From 10 to 90 % of its rise. One edge only, chosen because it changed.",
        ),
        Measure(
            "resolution by FRC",
            "px",
            facts.frc_resolution_px,
            "less",
            False,
            "How far slices from even and odd projections agree. Both share the same wrong angles.",
        ),
    ]
    for name, key, better, note in SHARPNESS_TOLD:
        told = sharpness.get(key, nothing)
        made.append(
            Measure(name, "1/px²" if key != "contrast" else "1/px", told, better, False, note)
        )
    return made


SHARPNESS_TOLD: tuple[tuple[str, str, Literal["less", "more"], str], ...] = (
    (
        "total variation",
        "total_variation",
        "less",
        "Streaks raise it, and so do sharp edges: on real objects it hardly tells the two apart.",
    ),
    (
        "gradient energy",
        "gradient_energy",
        "more",
        "Sharp edges raise it, and so does noise.",
    ),
    ("contrast", "contrast", "more", "Spread of the grey values; blur lowers it a little."),
)
"""Name, key of `SHARPNESS`, which direction usually is better, note."""
