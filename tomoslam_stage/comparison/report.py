"""The report as a file that programs read, with all that is made beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tomoslam_stage.comparison.findings import (
    Findings,
    Run,
    gauge,
    median_sigma_deg,
    residual_change,
)
from tomoslam_stage.comparison.logbook import draw_logbook, logbook_line
from tomoslam_stage.comparison.page import contents, write_page
from tomoslam_stage.comparison.plain import as_json, one_column, plain
from tomoslam_stage.comparison.regions import rms
from tomoslam_stage.comparison.slices_picture import draw_comparison
from tomoslam_stage.comparison.theta_picture import draw_theta
from tomoslam_stage.comparison.versions import versions
from tomoslam_stage.comparison.writing import made_folder, write_atomically
from tomoslam_stage.frames import of_all_frames, shift_in_file
from tomoslam_stage.products import Comparison, Event, Floats, Refinement, Scan

FORMAT = 1
"""Of report.json; it grows when a key goes or changes its meaning."""


def write_report(folder: Path, findings: Findings, run: Run) -> dict[str, Any]:
    """Write the pictures, the page, theta.txt and, last of all, report.json into `folder`.

    ``theta.txt`` holds the angles that stand: degrees, one a line, no header, every digit (what
    nabu takes as ``angles_file``). ``shift.txt`` holds the shifts that stand with them, px of the
    detector to the right, where the sample may have moved; ``nan`` for frames that were left out.
    Without reconstructions there is no comparison.png, and one of an earlier run goes. Each file
    appears whole or not at all.

    Returns
    -------
    The report, as `report` describes it.

    Raises
    ------
    PipelineError
        If the folder or a file cannot be written.
    """
    made_folder(folder)
    if {"recorded", "refined"} <= set(findings.reconstructions):
        draw_comparison(folder / "comparison.png", findings)
    else:
        (folder / "comparison.png").unlink(missing_ok=True)
    draw_theta(folder / "theta.png", findings)
    draw_logbook(folder / "logbook.png", findings, run)
    write_atomically(folder / "theta.txt", one_column(theta_of_frames(findings)))
    write_shifts(folder / "shift.txt", findings)
    made = report(findings, run)
    write_page(folder / "report.html", contents(findings, made))
    write_atomically(folder / "report.json", as_json(made))
    return made


def report(findings: Findings, run: Run) -> dict[str, Any]:
    """Tell in plain values what was found; what is not known is None.

    ``report.schema.json``, beside this file, says what each key means, and its unit.
    """
    refinement = findings.refinement
    counts = refinement.counts
    made = {
        "format": FORMAT,
        "status": refinement.status,
        "reason": refinement.reason,
        "scan": scan_facts(findings.scan),
        "n_projections": len(refinement.recorded),
        "n_features": counts.get("features"),
        "n_sightings": counts.get("sightings"),
        **change_facts("", refinement.theta - refinement.recorded),
        **change_facts("proposed_", refinement.change),
        "median_sigma_deg": median_sigma_deg(refinement),
        "axis_px": findings.scan.column_in_file(refinement.axis),
        "sources": refinement.sources,
        "events": in_file(refinement.events, findings.scan),
        "stage": stage_facts(refinement, findings.scan.binning),
        "gauge": gauge(refinement) or None,
        "comparison": comparison_facts(findings.comparison, refinement),
        "evidence": refinement.evidence,
        "counts": counts,
        "theta": theta_facts(refinement),
        "logbook_line": logbook_line(findings, run),
        "started": run.started or None,
        "seconds": run.seconds,
        "versions": versions(),
        "pipeline": run.pipeline,
    }
    return {key: plain(value) for key, value in made.items()}


def theta_of_frames(findings: Findings) -> Floats:
    """(m,) degrees: the angles that stand, one for every frame in the file."""
    refinement = findings.refinement
    return np.degrees(of_all_frames(findings.scan, refinement.theta, refinement.sigma).theta)


def write_shifts(path: Path, findings: Findings) -> None:
    """Write the shifts that stand; where there are none, those of an earlier run go."""
    refinement = findings.refinement
    if refinement.shift is None or refinement.status == "kept":
        path.unlink(missing_ok=True)
    else:
        write_atomically(path, one_column(shift_in_file(findings.scan, refinement.shift)))


def scan_facts(scan: Scan) -> dict[str, Any]:
    """Which scan it was."""
    shape = (scan.n_projections, scan.n_rows, scan.n_columns)
    return {
        "name": scan.name,
        "file": scan.path,
        "shape": shape,
        "binning": scan.binning,
        "left_out": scan.left_out,
    }


def in_file(events: Sequence[Event], scan: Scan) -> list[Event]:
    """Tell `events` by the frames of the file, which may have more of them than projections."""
    return [replace(event, projection=int(scan.frames[event.projection])) for event in events]


def theta_facts(refinement: Refinement) -> dict[str, Floats]:
    """Every angle and its sigma, degrees."""
    angles = {name: getattr(refinement, name) for name in ("recorded", "refined", "sigma")}
    return {f"{name}_deg": np.degrees(values) for name, values in angles.items()}


def change_facts(prefix: str, change: Floats) -> dict[str, float]:
    """How far angles moved by `change`, (n,) radians, told in degrees."""
    return {
        f"{prefix}rms_change_deg": math.degrees(rms(change)),
        f"{prefix}max_change_deg": math.degrees(float(np.abs(change).max(initial=0))),
    }


def stage_facts(refinement: Refinement, binning: int) -> dict[str, float | None]:
    """Tell how the rotation stage errs, how its axis is tilted, and how the sample moved on it."""
    noise, shift, sigma = refinement.stage_noise, refinement.shift, refinement.shift_sigma
    rolled = "used" in refinement.sources.values() and "roll" in refinement.unknowns
    return {
        "walk_deg": None if noise is None else math.degrees(noise.walk),
        "jitter_deg": None if noise is None else math.degrees(noise.jitter),
        "roll_deg": math.degrees(refinement.roll) if rolled else None,
        "shift_px": None if shift is None else float(np.std(shift)) * binning,
        "shift_sigma_px": None if sigma is None else float(np.median(sigma)) * binning,
    }


def comparison_facts(comparison: Comparison, refinement: Refinement) -> dict[str, Any]:
    """Put the numbers of the comparison under the names that `report` gives them."""
    change = residual_change(refinement)
    return {
        "residual_recorded": change.recorded,
        "residual_refined": change.refined,
        "residual_gain_percent": -change.percent,
        "heldout_rows": refinement.heldout_rows,
        "sharpness": comparison.sharpness,
        "psnr": comparison.similarity.get("psnr", {}),
        "ssim": comparison.similarity.get("ssim", {}),
        "frc_resolution_px": comparison.frc_resolution_px,
        "edge_width_px": comparison.edge_width_px,
        "errors": comparison.errors,
    }
