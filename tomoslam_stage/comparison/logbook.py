"""What goes into a logbook: one line of text, and one page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.findings import Findings, Run, median_sigma_deg, verdict
from tomoslam_stage.comparison.measures import Measure, measures
from tomoslam_stage.comparison.regions import rms
from tomoslam_stage.comparison.slice_pairs import slice_pairs
from tomoslam_stage.comparison.slices_picture import BLOCK, draw_slice, facts
from tomoslam_stage.comparison.theta_picture import draw_panels, height_of, panels_of
from tomoslam_stage.comparison.versions import version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT = canvas.WIDTH * math.sqrt(2)
"""Inches: the shape of an A4 page."""
A4_WIDTH = 210 / 25.4
"""Inches, as printed."""
LINE_HEIGHT = 0.2
CURVE_HEIGHTS = (1.9, 1.0)
"""Inches: correction, shifts."""
COLUMNS = (canvas.LEFT, 4.1, 5.3, 6.5, 7.7)
"""Inches: name, recorded, refined, true, what is better."""


def logbook_line(findings: Findings, run: Run) -> str:
    """One line to paste into a logbook."""
    refinement = findings.refinement
    change = np.degrees(refinement.change)
    said = [
        " ".join([moment(run.started), "tomoslam_stage", version("tomoslam-stage") or ""]),
        f"{findings.scan.name}: {verdict(findings)}",
        f"{len(change)} projections",
    ]
    if change.any():
        found = "correction" if refinement.status == "accepted" else "correction found"
        said.append(f"{found} {rms(change):.3g}° rms, {np.nanmax(np.abs(change)):.3g}° at most")
    if np.isfinite(sigma := median_sigma_deg(refinement)):
        said.append(f"median σ {sigma:.2g}°")
    if findings.scan.path is not None:
        said.append(str(findings.scan.path))
    return " · ".join(" ".join(part.split()) for part in said)


def moment(started: str) -> str:
    """Write an ISO 8601 time as people write it, to the minute; an empty one stays empty."""
    if not started:
        return ""
    return datetime.fromisoformat(started).astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def draw_logbook(path: Path, findings: Findings, run: Run) -> None:
    """Draw one page with the verdict, the slice that changed most, the correction and the numbers.

    Without reconstructions of both angles it has no slices.
    """
    made = {"recorded", "refined"} <= set(findings.reconstructions)
    told = [findings.refinement.reason, *([facts(findings)] if made else [findings.scan.name])]
    said = canvas.header(verdict(findings), told)
    figure = canvas.new_figure(HEIGHT)
    canvas.write_header(figure, said)
    top = said.height
    if made:
        (pair,) = slice_pairs(findings, None)
        draw_slice(figure, top, pair, findings.refinement.status)
        top += BLOCK
    panels = panels_of(findings, CURVE_HEIGHTS)
    draw_panels(figure, top, findings, panels)
    draw_table(figure, top + height_of(panels), measures(findings))
    # The path of the scan stays with the text: on a page it would only be cut off.
    line = " · ".join(logbook_line(findings, run).split(" · ")[:1])
    style = {"fontsize": canvas.SMALL_SIZE, "color": canvas.FAINT}
    canvas.write(figure, (canvas.LEFT, HEIGHT - 0.3), line, style)
    canvas.save(figure, path, canvas.WIDTH / A4_WIDTH * canvas.DPI)


def draw_table(figure: Figure, top: float, lines: Sequence[Measure]) -> None:
    """Write the numbers below each other, as far as the page goes."""
    names = ("recorded", "refined", "true")
    small = {"fontsize": canvas.SMALL_SIZE}
    bold = small | {"fontweight": "bold"}
    for left, words in zip(COLUMNS, ("", *names, "better"), strict=True):
        canvas.write(figure, (left, top), words, bold)
    room = int((HEIGHT - 0.4 - top) / LINE_HEIGHT) - 1
    for k, measure in enumerate(lines[:room]):
        unit = f" / {measure.unit}" if measure.unit else ""
        numbers = [shown(measure.values.get(name)) for name in names]
        better = measure.better + (", decides" if measure.decides else "")
        for left, words in zip(COLUMNS, (measure.name + unit, *numbers, better), strict=True):
            canvas.write(figure, (left, top + (k + 1) * LINE_HEIGHT), words, small)


def shown(value: float | None) -> str:
    """Write a number, or a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.4g}"
