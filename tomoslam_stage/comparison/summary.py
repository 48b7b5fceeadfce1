"""The closing words of a run."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tomoslam_stage.comparison.sparkline import ASCII, BLOCKS, sparkline

LABEL = 14
WIDTH = 100
FILES = "report.html, logbook.png, comparison.png, theta.png, theta.txt, report.json"
MOST_EVENTS = 5
MOST_FRAMES = 5
"""More are only counted."""


def summary(report: Mapping[str, Any], folder: Path | None = None, *, unicode: bool = True) -> str:
    """Tell in about a dozen lines what a report says, the last of them to paste into a logbook.

    Parameters
    ----------
    report
        As `comparison.report` makes it.
    folder
        Where the pictures are.
    unicode
        Draw the correction with blocks; else there are no signs but those of ASCII.
    """
    first = f"{report['scan']['name']}: {HEADLINES[report['status']]}"
    said = {
        "why": report["reason"],
        "sources": sources(report),
        "frames": frames(report["scan"]["left_out"]),
        "angles": angles(report),
        "correction": correction(report, BLOCKS if unicode else ASCII),
        "sigma": sigma(report["median_sigma_deg"]),
        "events": events(report["events"]),
        "stage": stage(report["stage"]),
        "axis": f"detector column {number(report['axis_px'], 6)}",
        "residual": residual(report),
        "rows": rows((report["evidence"] or {}).get("rigidity")),
        "slices": slices(report["comparison"]),
        "true slices": true_slices(report["comparison"]),
        "true errors": true_errors(report["comparison"]["errors"]),
        "features": features(report),
        "report": "" if folder is None else f"{folder}: {FILES}",
        "time": time(report["seconds"]),
    }
    lines = [first, *(entry(label, text) for label, text in said.items() if text)]
    # Not broken into lines: it is to be pasted. A terminal without blocks knows no degree sign.
    line = report["logbook_line"]
    return "\n".join([*lines, line if unicode else in_ascii(line)])


def in_ascii(line: str) -> str:
    """Write `line` with what every terminal knows; names that users chose stay as they are."""
    for sign, word in {"°": " deg", "σ": "sigma", "−": "-", " · ": "; "}.items():
        line = line.replace(sign, word)
    return line


def correction(report: Mapping[str, Any], levels: str) -> str:
    """Draw refined minus recorded along the scan; empty where there is no correction."""
    if not report["proposed_max_change_deg"]:
        return ""
    theta = report["theta"]
    angles = [np.array(theta[f"{name}_deg"], np.float64) for name in ("recorded", "refined")]
    change = angles[1] - angles[0]
    curve = sparkline(change, levels)
    return f"{curve} {np.nanmin(change):+.2g} to {np.nanmax(change):+.2g} deg"


HEADLINES = {
    "accepted": "the refined angles are accepted",
    "kept": "the recorded angles are kept, nothing was changed",
}


def entry(label: str, text: str) -> str:
    """Put `label` before `text`, which goes on below itself where it is long."""
    indent = " " * LABEL
    lead = f"  {label}".ljust(LABEL)
    return textwrap.fill(text, WIDTH, initial_indent=lead, subsequent_indent=indent)


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with a few digits, or that it is not known."""
    return "unknown" if value is None else f"{value:.{digits}g}"


def angles(report: Mapping[str, Any]) -> str:
    """How many, and how far they moved or would have moved."""
    if not report["proposed_max_change_deg"]:
        return f"{report['n_projections']} projections; no correction was found"
    moved = f"{number(report['proposed_rms_change_deg'])} deg rms, "
    moved += f"{number(report['proposed_max_change_deg'])} deg at most"
    verb = "changed by" if report["status"] == "accepted" else "would have changed by"
    return f"{report['n_projections']} projections; {verb} {moved}"


def sigma(median: float | None) -> str:
    """How sure the angles are by the factors' own account."""
    return "" if median is None else f"{number(median)} deg, median of the angles found"


def sources(report: Mapping[str, Any]) -> str:
    """Which sources were believed, and why others were not; empty where the reason said it.

    Of a long scan, how many projections they were asked about.
    """
    said = "; ".join(f"{name} {note}" for name, note in report["sources"].items())
    if said == report["reason"]:
        return ""
    keys = report["counts"].get("key projections")
    asked = "" if keys is None else f"; of {keys} key projections, the others placed in their map"
    return said + asked


def frames(left_out: Mapping[str, str]) -> str:
    """Name the frames that are not used, the first few of them with the reason."""
    said = [f"{frame} ({why})" for frame, why in list(left_out.items())[:MOST_FRAMES]]
    more = len(left_out) - len(said)
    return "left out: " + ", ".join(said) + (f" and {more} more" if more else "") if said else ""


def events(all_events: Sequence[Mapping[str, Any]]) -> str:
    """Name the surest lapses of the stage, in their order, and count the others."""
    surest = sorted(all_events, key=lambda event: -event["significance"])[:MOST_EVENTS]
    said = [
        f"{event['kind']} of {event['size_deg']:+.3g} deg before projection {event['projection']} "
        f"({number(event['significance'], 2)} sigma)"
        for event in sorted(surest, key=lambda event: int(event["projection"]))
    ]
    more = len(all_events) - len(said)
    return "; ".join(said) + (f"; and {more} more" if more else "")


def stage(facts: Mapping[str, float | None]) -> str:
    """How the stage errs, how its axis is tilted and the sample moved, where that is known."""
    said = []
    if facts["walk_deg"] is not None:
        walk, jitter = number(facts["walk_deg"], 2), number(facts["jitter_deg"], 2)
        said.append(f"error of the recorded steps: walk {walk} deg a step, jitter {jitter} deg")
    if facts["roll_deg"] is not None:
        said.append(f"roll of the axis {facts['roll_deg']:z.3f} deg")
    if facts["shift_px"] is not None:
        sigma = "" if facts["shift_sigma_px"] is None else number(facts["shift_sigma_px"], 2)
        known = sigma and f" (median sigma {sigma})"
        said.append(f"projections shifted by {number(facts['shift_px'], 2)} px rms{known}")
    return "; ".join(said)


def residual(report: Mapping[str, Any]) -> str:
    """Tell how well the rows reproject with both sets of angles."""
    facts = report["comparison"]
    if facts["residual_gain_percent"] is None:
        return ""
    where = "unused rows" if facts["heldout_rows"] else "the rows used"
    text = f"{where} reproject with {number(facts['residual_recorded'], 4)} (recorded), "
    text += f"{number(facts['residual_refined'], 4)} (refined): "
    text += f"{-facts['residual_gain_percent']:+.1f} %"
    sure = (report["evidence"] or {}).get("residual_gain_sigma")
    if sure is None:
        return text
    return f"{text} ({number(abs(sure), 2)} standard errors {'better' if sure >= 0 else 'worse'})"


def rows(rigidity: Mapping[str, Any] | None) -> str:
    """Tell whether features keep their rows, as those of a rigid sample in a parallel beam do."""
    if rigidity is None:
        return ""
    moved, cone = number(rigidity["moved_px"], 2), number(abs(rigidity["cone_px"]), 2)
    return (
        f"those of {rigidity['features']} features move by {moved} px as the scan goes on "
        f"({rigidity['moved_significance']:z.1f} standard errors), by {cone} px with depth "
        f"({abs(rigidity['cone_significance']):.1f})"
    )


def true_errors(errors: Mapping[str, float | None]) -> str:
    """How far from the truth, where it is known."""
    if not errors:
        return ""
    text = f"{number(errors['recorded_rms_deg'])} deg (recorded), "
    text += f"{number(errors['refined_rms_deg'])} deg (refined) rms, mean removed; "
    return text + f"error ratio {number(errors['error_ratio'])}"


def slices(facts: Mapping[str, Any]) -> str:
    """Tell how sharp the slices are and how far above the noise; none of it is a verdict."""
    return "; ".join(
        f"{what} {both(facts[key], 'px')}"
        for what, key in {
            "width of the most changed edge": "edge_width_px",
            "resolution by FRC of halves": "frc_resolution_px",
        }.items()
        if facts[key]
    )


def true_slices(facts: Mapping[str, Any]) -> str:
    """How near the slices are to those made with the true angles, where these are known."""
    if not facts["psnr"]:
        return ""
    return f"PSNR {both(facts['psnr'], 'dB')}; SSIM {both(facts['ssim'])}"


def both(values: Mapping[str, float | None], unit: str = "") -> str:
    """Write a number of the recorded and of the refined slices."""

    def one(value: float | None) -> str:
        return number(value) + ("" if value is None or not unit else f" {unit}")

    return ", ".join(f"{one(values[name])} ({name})" for name in ("recorded", "refined"))


def features(report: Mapping[str, Any]) -> str:
    """How much was seen."""
    if report["n_features"] is None:
        return ""
    return f"{report['n_features']} features, {report['n_sightings']} sightings"


def time(seconds: Mapping[str, float]) -> str:
    """Seconds in all, and the stations they went to, the longest first."""
    if not seconds:
        return ""
    longest = sorted(seconds.items(), key=lambda station: station[1], reverse=True)
    return f"{sum(seconds.values()):.0f} s: " + ", ".join(f"{k} {v:.1f}" for k, v in longest)
