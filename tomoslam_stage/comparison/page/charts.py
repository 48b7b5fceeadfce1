"""Curves and bars of the page as plain data: what is drawn, not how."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison.events import place
from tomoslam_stage.comparison.findings import residual_change, rows_word
from tomoslam_stage.comparison.graphs import Graph, graphs_of
from tomoslam_stage.comparison.histograms import Histogram, histograms_of
from tomoslam_stage.comparison.metrics import difference_of_angles
from tomoslam_stage.comparison.page.packing import rounded
from tomoslam_stage.comparison.shifts import shifts_of
from tomoslam_stage.comparison.slice_pairs import slice_pairs
from tomoslam_stage.comparison.theta_picture import abscissa

if TYPE_CHECKING:
    from tomoslam_stage.comparison.findings import Findings
    from tomoslam_stage.products import Floats


def line(style: str, label: str, x: Floats, y: Floats) -> dict[str, Any]:
    """One curve (n,)."""
    return {"kind": "line", "style": style, "label": label, "x": rounded(x), "y": rounded(y)}


def band(sigma: Floats) -> list[dict[str, Any]]:
    """One and two sigma (n,) about the first curve; nothing where none is known."""
    if not np.isfinite(sigma).any():
        return []
    return [{"kind": "band", "style": "refined", "label": "± 1 and 2 σ", "width": rounded(sigma)}]


def correction_chart(findings: Findings) -> dict[str, Any] | None:
    """Refined minus recorded with its sigma and the lapses of the stage; None where none moved."""
    refinement = findings.refinement
    if not refinement.change.any():
        return None
    along, label = abscissa(refinement.recorded)
    change, sigma = np.degrees(refinement.change), np.degrees(refinement.sigma)
    stands = refinement.status == "accepted"
    name = "correction" if stands else "correction found, not used"
    series = [line("refined", name, along, change), *band(sigma)]
    if findings.truth is not None:
        true = np.degrees(difference_of_angles(findings.truth.theta, refinement.recorded))
        true += np.nanmean(change - true)
        series.append(line("true", "true correction (same mean)", along, true))
    return {
        "title": "refined − recorded",
        "labels": [label, "degrees"],
        "series": series,
        "marks": [
            {
                "x": place(along, event),
                "label": f"{event.kind} {event.size_deg:+.2f}°, {event.significance:.0f} σ, "
                f"before projection {findings.scan.frames[event.projection]}",
            }
            for event in refinement.events
        ],
        "zero": True,
        "items": items(findings),
    }


def shift_chart(findings: Findings) -> dict[str, Any] | None:
    """Tell how far each projection lies to the right; None where nobody looked."""
    shifts = shifts_of(findings)
    if shifts is None:
        return None
    along, label = abscissa(findings.refinement.recorded)
    stands = findings.refinement.status == "accepted"
    name = "shift" if stands else "shift found, not used"
    series = [line("refined", name, along, shifts.found), *band(shifts.sigma)]
    if shifts.true is not None:
        series.append(line("true", "true shift (same axis and place)", along, shifts.true))
    return {
        "title": "shift of the sample on its stage",
        "labels": [label, "detector px to the right"],
        "series": series,
        "zero": True,
        "items": items(findings),
    }


def residual_chart(findings: Findings) -> dict[str, Any] | None:
    """Tell how well each projection reprojects; None where nobody looked."""
    refinement = findings.refinement
    if not np.isfinite(residual_change(refinement).percent):
        return None
    along, label = abscissa(refinement.recorded)
    shown = ("recorded", "refined") if refinement.change.any() else ("recorded",)
    series = [line(name, f"{name} angles", along, refinement.reprojection[name]) for name in shown]
    where = rows_word(refinement.heldout_rows)
    return {
        "title": f"reprojection residual on {where}",
        "labels": [label, "line integral"],
        "series": series,
        "items": items(findings),
    }


def items(findings: Findings) -> list[str]:
    """Name each projection by its number in the file."""
    return [f"projection {frame}" for frame in findings.scan.frames.tolist()]


def graph_chart(graph: Graph) -> dict[str, Any]:
    """Curves of the pictures, drawn by the page."""
    return {
        "title": graph.title,
        "remark": graph.remark,
        "labels": list(graph.labels),
        "logarithmic": graph.logarithmic,
        "series": [line(c.name, c.label, c.x, c.y) for c in graph.curves],
    }


def histogram_chart(histogram: Histogram) -> dict[str, Any]:
    """Bars, and the normal distribution beside them where there is one."""
    middles = (histogram.edges[1:] + histogram.edges[:-1]) / 2
    edges, counts = rounded(histogram.edges), rounded(histogram.counts)
    bars = {"kind": "bars", "style": "refined", "label": histogram.labels[1]}
    series: list[dict[str, Any]] = [bars | {"edges": edges, "y": counts, "x": rounded(middles)}]
    if histogram.normal is not None:
        series.append(line("threshold", "normal, this scale", middles, histogram.normal))
    return {
        "title": histogram.title,
        "remark": histogram.remark,
        "labels": list(histogram.labels),
        "series": series,
    }


def track_charts(findings: Findings) -> list[dict[str, Any]]:
    """Track lengths and residuals of the sightings, where features were placed."""
    return [histogram_chart(histogram) for histogram in histograms_of(findings.refinement)]


def slice_charts(findings: Findings) -> list[dict[str, Any]]:
    """Edge, ring correlation and convergence; none where nothing was refined."""
    if not {"recorded", "refined"} <= set(findings.reconstructions):
        return []
    if not findings.refinement.change.any():
        return []
    (pair,) = slice_pairs(findings, None)
    return [graph_chart(graph) for graph in graphs_of(findings, pair)]
