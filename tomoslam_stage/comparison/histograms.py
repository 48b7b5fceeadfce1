"""How long the tracks are, and how far sightings lie from where they were expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box
from tomoslam_stage.images import robust_scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tomoslam_stage.products import Floats, Refinement

HISTOGRAMS_HEIGHT = 2.9
"""Inches."""
PANEL_TOP, PANEL_HEIGHT = 0.68, 1.6
"""Inches; a title, a remark and the legend stand above a panel."""
LEFT, GAP, RIGHT = canvas.LEFT + 0.3, 0.95, 0.3
MOST_BARS = 40
REACH = 5.0
"""Robust scales to either side that residuals are drawn over."""


@dataclass(frozen=True)
class Histogram:
    """One panel."""

    title: str
    remark: str
    """Said below the title, in small."""
    labels: tuple[str, str]
    """Of x and y."""
    edges: Floats
    """(b + 1,) of the bars."""
    counts: Floats
    """(b,)"""
    normal: Floats | None = None
    """(b,) what a normal distribution of the same scale would have, where one is drawn."""


def histograms_of(refinement: Refinement) -> list[Histogram]:
    """Make the panels of what there is to show."""
    made = []
    for name, histogram in {
        "track_lengths": lengths_histogram,
        "sighting_residuals": residuals_histogram,
    }.items():
        values = refinement.histograms.get(name, np.empty(0))
        values = values[np.isfinite(values)]
        if len(values):
            made.append(histogram(values))
    return made


def lengths_histogram(lengths: Floats) -> Histogram:
    """Count features by their number of sightings (f,)."""
    longest = int(lengths.max())
    width = -(-longest // MOST_BARS)
    edges = np.arange(0.5, longest + width + 0.5, width)
    remark = f"{len(lengths)} features, half of them with {np.median(lengths):.0f} or more"
    labels = ("sightings of a feature", "features")
    return Histogram("track lengths", remark, labels, edges, counted(lengths, edges))


def residuals_histogram(residuals: Floats) -> Histogram:
    """Count sightings by their residual (s,), px, beside a normal distribution."""
    scale = robust_scale(residuals)
    reach = REACH * scale if scale > 0 else max(float(np.abs(residuals).max()), 1.0)
    edges = np.linspace(-reach, reach, MOST_BARS + 2)
    counts = counted(residuals, edges)
    beyond = 100 * (1 - counts.sum() / len(residuals))
    remark = f"{len(residuals)} sightings, robust scale {scale:.3g} px"
    remark += f"; {beyond:.1f} % lie farther out" if beyond else ""
    normal = len(residuals) * normal_share(edges, scale) if scale > 0 else None
    labels = ("column seen − column expected / px", "sightings")
    return Histogram("residuals of the sightings", remark, labels, edges, counts, normal)


def counted(values: Floats, edges: Floats) -> Floats:
    """(b,) how many of `values` lie between each two of `edges` (b + 1,)."""
    return np.histogram(values, edges)[0].astype(np.float64)


def normal_share(edges: Floats, scale: float) -> Floats:
    """(b,) of a normal distribution, what lies in the middle of each bar times its width."""
    z = (edges[1:] + edges[:-1]) / (2 * scale)
    return np.asarray(np.exp(-(z**2) / 2) * np.diff(edges) / (np.sqrt(2 * np.pi) * scale))


def draw_histograms(figure: Figure, top: float, histograms: Sequence[Histogram]) -> None:
    """Draw panels side by side, `top` inches down the picture."""
    step = (canvas.WIDTH - LEFT - RIGHT + GAP) / 2
    for k, histogram in enumerate(histograms):
        box = Box(LEFT + k * step, top + PANEL_TOP, step - GAP, PANEL_HEIGHT)
        remark = {"fontsize": canvas.SMALL_SIZE, "color": canvas.FAINT}
        canvas.write(figure, (box.left, top), histogram.title, {"fontsize": canvas.TEXT_SIZE})
        canvas.write(figure, (box.left, top + 0.19), histogram.remark, remark)
        draw_histogram(figure, box, histogram)


def draw_histogram(figure: Figure, box: Box, histogram: Histogram) -> None:
    """Draw one panel with its legend above it."""
    axes = canvas.panel(figure, box)
    bars: dict[str, Any] = {"color": canvas.REFINED, "alpha": 0.55, "linewidth": 0}
    axes.stairs(histogram.counts, histogram.edges, fill=True, **bars, label=histogram.labels[1])
    if histogram.normal is not None:
        middles = (histogram.edges[1:] + histogram.edges[:-1]) / 2
        axes.plot(
            middles, histogram.normal, color=canvas.INK, linewidth=0.9, label="normal, this scale"
        )
    axes.set_xlabel(histogram.labels[0], **canvas.AXIS_LABEL)
    axes.set_ylabel(histogram.labels[1], **{**canvas.AXIS_LABEL, "labelpad": 3})
    axes.set_ylim(0, max(axes.get_ylim()[1], 1.0))
    # Counts are read as they are: no power of ten above the axis.
    axes.yaxis.set_major_formatter("{x:g}")
    canvas.finish(axes, loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
