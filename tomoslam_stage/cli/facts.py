"""The facts of a scan as a table that someone reads who did not take it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from tomoslam_stage.cli.arguments import one_line

Facts: TypeAlias = Mapping[str, Any]

MEANS: Mapping[str, str] = {
    "counts": "counts; flats and darks make line integrals of them",
    "transmission": "transmission; its logarithm makes line integrals",
    "line_integrals": "line integrals, ready for use",
}
"""Kind of values -> what is done with them."""
MOST = 12
"""Lines of a list that are shown."""


def table(facts: Facts) -> str:
    """Lay out the facts that `scans.describe_scan` collects, in two columns."""
    rows = {
        "file": [f"{facts['file']} ({facts['layout']})"],
        "projections": [_projections(facts)],
        "flats, darks": [_references(facts)],
        "values": [MEANS.get(facts.get("kind", ""), "unknown")],
        "angles": [_angles(facts)],
        "unit stored": [facts["theta_units"] or "none; the span tells degrees from radians"],
        "refined": [_refined(facts)],
        "left out": _some(facts.get("frames_left_out", [])),
        "beam": [_beam(facts)],
        "simulated": ["yes, with the true angles" if facts["simulated"] else "no"],
        "problems": list(facts["problems"]) or ["none"],
    }
    if facts["recovered"]:
        rows["recovered"] = ["an edit that had been interrupted was finished, or undone"]
    width = max(map(len, rows)) + 2
    return "\n".join(
        f"{label if i == 0 else '':<{width}}{one_line(line)}"
        for label, lines in rows.items()
        for i, line in enumerate(lines)
    )


def _projections(facts: Facts) -> str:
    shape = facts["shape"]
    if shape is None or len(shape) != 3:
        return "none" if shape is None else f"an array {shape}, which is no stack"
    used = facts.get("projections", shape[0])
    return f"{used} of {shape[1]} rows x {shape[2]} columns, {facts['dtype']}"


def _references(facts: Facts) -> str:
    groups = facts["flat_groups"]
    moments = f", taken at {groups} moments of the scan" if groups > 1 else ""
    return f"{facts['flats']} flats{moments}; {facts['darks']} darks"


def _angles(facts: Facts) -> str:
    if "first_deg" not in facts:
        return "unknown: see the problems"
    first, last, step = (facts[key] for key in ("first_deg", "last_deg", "median_step_deg"))
    least, most = facts["step_range_deg"]
    usual = f"mostly {step:.6g}, from {least:.6g} to {most:.6g}"
    if f"{least:.6g}" == f"{most:.6g}":
        usual = f"of {step:.6g}"
    return f"{first:.6g} to {last:.6g} degrees; steps {usual}"


def _refined(facts: Facts) -> str:
    if facts["refined"]:
        return "yes; the recorded angles are kept beside them (revert puts them back)"
    return "no, these are the recorded angles"


def _beam(facts: Facts) -> str:
    magnification = facts["magnification"]
    if magnification is None:
        return "no distances are stored; it is taken for parallel"
    return f"magnification {magnification:.6g}"


def _some(lines: Sequence[str]) -> list[str]:
    more = len(lines) - MOST
    return [*lines[:MOST], *([f"and {more} more"] if more > 0 else [])] or ["none"]
