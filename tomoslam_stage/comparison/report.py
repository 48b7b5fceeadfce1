"""The report as a file that programs read, and the angles as one column."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from tomoslam_stage.comparison.findings import Findings, Run, gauge, residual_change
from tomoslam_stage.comparison.regions import rms
from tomoslam_stage.comparison.slices_picture import draw_comparison
from tomoslam_stage.comparison.theta_picture import draw_theta
from tomoslam_stage.comparison.writing import made_folder, write_atomically
from tomoslam_stage.products import Comparison, Floats, Refinement, Scan

PACKAGES = (
    "tomoslam-stage",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "mahotas",
    "gtsam",
    "finufft",
    "tomopy",
    "h5py",
    "pydantic",
    "matplotlib",
)
"""All that can change a result."""


def write_report(folder: Path, findings: Findings, run: Run) -> dict[str, Any]:
    """Write comparison.png, theta.png, theta.txt and, last of all, report.json into `folder`.

    ``theta.txt`` holds the angles that stand: degrees, one a line, no header, every digit (what
    nabu takes as ``angles_file``). Without reconstructions there is no comparison.png, and one of
    an earlier run goes. Each file appears whole or not at all.

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
    write_atomically(folder / "theta.txt", one_column(np.degrees(findings.refinement.theta)))
    made = report(findings, run)
    write_atomically(folder / "report.json", as_json(made))
    return made


def report(findings: Findings, run: Run) -> dict[str, Any]:
    """Tell in plain values what was found; what is not known is None.

    Returns
    -------
    ``status``, ``reason``
        ``accepted`` or ``kept``, and why, in numbers.
    ``scan``
        ``name``, ``file``, ``shape`` (projections, rows, columns as they were worked on) and
        ``binning`` (detector pixels in one of these).
    ``n_projections``, ``n_features``, ``n_sightings``
        Counts; the latter two as refinement counted them.
    ``rms_change_deg``, ``max_change_deg``
        degrees: how far the angles that stand are from the recorded ones; 0 where these are kept.
    ``proposed_rms_change_deg``, ``proposed_max_change_deg``
        degrees: the same of the angles that were found, whether they stand or not.
    ``median_sigma_deg``
        degrees, one standard deviation of the angles that were found.
    ``axis_px``
        px, column of the rotation axis that goes with the angles that stand, on the detector of
        the file (not binned, from 0).
    ``sources``
        Source of angle measurements -> ``used`` or ``left out: why``; empty where the pipeline has
        triplets only.
    ``events``
        Lost steps and the like, in order: ``projection`` (the first one after it, from 0),
        ``size_deg`` (how much farther the stage went than recorded), ``significance`` (standard
        deviations of a step) and ``kind``.
    ``stage``
        degrees: ``walk_deg`` (error of each recorded step) and ``jitter_deg`` (error of each
        angle by itself), None where they were not estimated; ``roll_deg``, tilt of the axis in the
        detector plane, None where it was not looked for.
    ``gauge``
        What no scan tells about its angles, and how that was settled; None where none were found.
    ``comparison``
        ``residual_recorded`` and ``residual_refined`` (line integrals, reprojection residual, rms
        over the projections), ``residual_gain_percent`` (how much of it is gone; more is better),
        ``heldout_rows`` (unused; of the binned scan), ``errors`` (see `errors_against`; empty
        without truth). Of the slices by name, no verdict: ``psnr`` (dB) and ``ssim`` against those
        of the true angles, ``frc_resolution_px`` (of even and odd projections), ``edge_width_px``
        (10 to 90 % of the most changed edge; px of the binned scan), ``sharpness`` by metric first.
    ``evidence``
        What the gate weighed (the fields of `Evidence`), None where it did not come that far.
    ``counts``
        All that refinement counted.
    ``seconds``
        Station -> s.
    ``versions``
        Package -> version, None where it is not installed; ``python`` too.
    ``pipeline``
        The entries as they ran.
    """
    refinement = findings.refinement
    counts = refinement.counts
    made = {
        "status": refinement.status,
        "reason": refinement.reason,
        "scan": scan_facts(findings.scan),
        "n_projections": len(refinement.recorded),
        "n_features": counts.get("features"),
        "n_sightings": counts.get("sightings"),
        **change_facts("", refinement.theta - refinement.recorded),
        **change_facts("proposed_", refinement.change),
        "median_sigma_deg": math.degrees(float(np.median(refinement.sigma))),
        "axis_px": findings.scan.column_in_file(refinement.axis),
        "sources": refinement.sources,
        "events": refinement.events,
        "stage": stage_facts(refinement),
        "gauge": gauge(refinement) or None,
        "comparison": comparison_facts(findings.comparison, refinement),
        "evidence": refinement.evidence,
        "counts": counts,
        "seconds": run.seconds,
        "versions": versions(),
        "pipeline": run.pipeline,
    }
    return {key: plain(value) for key, value in made.items()}


def scan_facts(scan: Scan) -> dict[str, Any]:
    """Which scan it was."""
    shape = (scan.n_projections, scan.n_rows, scan.n_columns)
    return {"name": scan.name, "file": scan.path, "shape": shape, "binning": scan.binning}


def change_facts(prefix: str, change: Floats) -> dict[str, float]:
    """How far angles moved by `change`, (n,) radians, told in degrees."""
    return {
        f"{prefix}rms_change_deg": math.degrees(rms(change)),
        f"{prefix}max_change_deg": math.degrees(float(np.abs(change).max(initial=0))),
    }


def stage_facts(refinement: Refinement) -> dict[str, float | None]:
    """Tell in degrees how the rotation stage errs, and how its axis is tilted."""
    noise = refinement.stage_noise
    rolled = "used" in refinement.sources.values()
    return {
        "walk_deg": None if noise is None else math.degrees(noise.walk),
        "jitter_deg": None if noise is None else math.degrees(noise.jitter),
        "roll_deg": math.degrees(refinement.roll) if rolled else None,
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


def versions() -> dict[str, str | None]:
    """Package -> version, None where it is not installed."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def version(package: str) -> str | None:
    """Version of `package`, None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def plain(value: Any) -> Any:
    """Turn `value` into what strict JSON can say; nan and infinity become None.

    Raises
    ------
    TypeError
        For a value that is no number, text, path, sequence, mapping or dataclass.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    elif is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    match value:
        case float():
            return value if math.isfinite(value) else None
        case None | int() | str():
            return value
        case Path():
            return str(value)
        case Mapping():
            return {str(key): plain(entry) for key, entry in value.items()}
        case Sequence():
            return [plain(entry) for entry in value]
    raise TypeError(f"a report cannot hold {value!r} of type {type(value).__name__}")


def as_json(made: Mapping[str, Any]) -> bytes:
    """Write a report as strict JSON, readable by people too."""
    text = json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False)
    return (text + "\n").encode()


def one_column(values: Floats) -> bytes:
    """One number a line, with every digit it takes to read the same float64 again."""
    return "".join(f"{value!r}\n" for value in values.tolist()).encode()
