"""The curves below the slices: edge, ring correlation and convergence, each in a panel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box
from tomoslam_stage.comparison.edges import edge_widths
from tomoslam_stage.comparison.named import wholes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomoslam_stage.comparison.findings import Findings
    from tomoslam_stage.comparison.slice_pairs import SlicePair
    from tomoslam_stage.products import Comparison, Floats, Reconstructions

GRAPHS_HEIGHT = 3.9
"""Inches."""
LEGEND_TOP, PANEL_TOP, PANEL_HEIGHT = 0.4, 1.35, 2.05
"""Inches; a title and a remark stand above the legend."""
MOST_SHARE = 0.5
"""Of the width, even for a panel that is alone."""
GAP, LEFT, RIGHT = 0.85, canvas.LEFT + 0.1, 0.3
"""Inches between the panels, where tick labels stand, and beside them."""
STYLES: dict[str, dict[str, Any]] = {
    "recorded": {"color": canvas.RECORDED, "linewidth": 2.2},
    "refined": {"color": canvas.REFINED, "linewidth": 1.4},
    "true": {"color": canvas.TRUE, "linewidth": 1.2, "linestyle": (0, (4, 2))},
    "threshold": {"color": canvas.INK, "linewidth": 0.8, "linestyle": (0, (1, 1.5))},
}
"""Lines that lie over each other are all seen."""


@dataclass(frozen=True)
class Curve:
    """One line."""

    name: str
    """Key of `STYLES`."""
    x: Floats
    y: Floats
    label: str


@dataclass(frozen=True)
class Graph:
    """One panel."""

    title: str
    remark: str
    """Said below the title, in small."""
    labels: tuple[str, str]
    """Of x and y."""
    curves: Sequence[Curve]
    logarithmic: bool = False
    """The y axis."""


def graphs_of(findings: Findings, pair: SlicePair) -> list[Graph]:
    """Make the panels of what there is to show; the edge is that of `pair`."""
    made = [
        edge_graph(pair),
        ring_graph(findings.comparison),
        convergence_graph(findings.reconstructions),
    ]
    return [graph for graph in made if graph is not None]


def edge_graph(pair: SlicePair) -> Graph | None:
    """Show the profile across the edge that changed most, where one did."""
    if pair.edge is None:
        return None
    places = pair.edge.places
    profiles = {name: pair.edge.profile(image) for name, image in pair.images.items()}
    curves = [
        Curve(name, places, profiles[name], f"{name}: {in_px(width)}")
        for name, width in edge_widths(places, profiles).items()
    ]
    remark = f"{pair.label}; px from 10 to 90 %"
    labels = ("px across the edge", "attenuation / px")
    return Graph("profile across the most changed edge", remark, labels, curves)


def ring_graph(comparison: Comparison) -> Graph | None:
    """Show how well even and odd projections agree, where there are halves."""
    if not comparison.frc:
        return None
    frequency = comparison.frc_frequency
    curves = [
        Curve(name, frequency, correlation, f"{name}: {in_px(comparison.frc_resolution_px[name])}")
        for name, correlation in comparison.frc.items()
    ]
    curves.append(Curve("threshold", frequency, comparison.frc_threshold, "half-bit threshold"))
    remark = "no verdict: both halves share the wrong angles"
    labels = ("cycles / px", "Fourier ring correlation")
    return Graph("FRC of even and odd projections", remark, labels, curves)


def convergence_graph(reconstructions: Reconstructions) -> Graph | None:
    """Show what is left of the sinograms in each iteration, where the algorithm iterates."""
    curves = [
        Curve(
            name,
            np.arange(len(made.convergence), dtype=float),
            made.convergence,
            f"{name}: {made.convergence[-1]:.3g} in the end",
        )
        for name, made in wholes(reconstructions).items()
        if len(made.convergence)
    ]
    if not curves:
        return None
    remark = "no verdict: these rows were used"
    labels = ("iteration", "left of the sinograms, rms")
    return Graph("convergence", remark, labels, curves, logarithmic=True)


def in_px(value: float) -> str:
    """Write a length; not every edge rises from 10 to 90 %."""
    return f"{value:.3g} px" if np.isfinite(value) else "not measurable"


def draw_graphs(figure: Figure, top: float, graphs: Sequence[Graph]) -> None:
    """Draw panels side by side, `top` inches down the picture, over its whole width."""
    whole = canvas.WIDTH - LEFT - RIGHT + GAP
    for k, graph in enumerate(graphs):
        step = whole * min(1 / len(graphs), MOST_SHARE)
        draw_graph(figure, Box(LEFT + k * step, top, step - GAP, PANEL_HEIGHT), graph)


def draw_graph(figure: Figure, box: Box, graph: Graph) -> None:
    """Draw one panel with its title, remark and legend above it."""
    canvas.write(figure, (box.left, box.top), graph.title, {"fontsize": canvas.TEXT_SIZE})
    remark = {"fontsize": canvas.SMALL_SIZE, "color": canvas.FAINT}
    canvas.write(figure, (box.left, box.top + 0.19), graph.remark, remark)
    axes = canvas.panel(figure, box._replace(top=box.top + PANEL_TOP))
    for curve in graph.curves:
        axes.plot(curve.x, curve.y, label=curve.label, **STYLES[curve.name])
    axes.set_xlabel(graph.labels[0], **canvas.AXIS_LABEL)
    axes.set_ylabel(graph.labels[1], **canvas.AXIS_LABEL)
    number_y_axis(axes, graph.logarithmic)
    legend_top = 1 + (PANEL_TOP - LEGEND_TOP) / PANEL_HEIGHT
    canvas.finish(axes, loc="upper left", bbox_to_anchor=(0, legend_top), ncols=1)


def number_y_axis(axes: Axes, logarithmic: bool) -> None:
    """Write plain numbers where the axis is logarithmic, else short ones."""
    if not logarithmic:
        axes.yaxis.set_major_formatter(canvas.short_numbers())
        axes.yaxis.get_offset_text().set(fontsize=canvas.SMALL_SIZE, color=canvas.INK)
        return
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
