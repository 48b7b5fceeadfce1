"""The picture of the slices: recorded and refined side by side, and what tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box
from tomoslam_stage.comparison.findings import Findings, verdict
from tomoslam_stage.comparison.graphs import GRAPHS_HEIGHT, draw_graphs, graphs_of
from tomoslam_stage.comparison.regions import Window
from tomoslam_stage.comparison.slice_pairs import SlicePair, slice_pairs
from tomoslam_stage.products import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


IMAGE = 2.68
COLUMNS = (canvas.LEFT, canvas.LEFT + IMAGE + 0.14, canvas.LEFT + 2 * IMAGE + 1.1)
BLOCK = 2 * IMAGE + 1.68
"""Height of all that is drawn of one slice, inches."""


def draw_comparison(path: Path, findings: Findings, rows: Sequence[int] | None = None) -> None:
    """Draw recorded and refined slices, their difference, and the part that changed most.

    Below stand the curves that go with them: the profile across the most changed edge, the Fourier
    ring correlation of halves, and how an iterative reconstruction converged.

    Parameters
    ----------
    path
        Of the PNG.
    findings
        With ``recorded`` and ``refined`` among the reconstructions.
    rows
        Detector rows of the slices, by default the one that changed most; of more than three the
        three that changed most.

    Raises
    ------
    ValueError
        If a row or one of the two reconstructions is missing.
    """
    pairs = slice_pairs(findings, rows)
    curves = graphs_of(findings, pairs[0])
    said = canvas.header(verdict(findings), [findings.refinement.reason, facts(findings)])
    bottom = said.height + BLOCK * len(pairs)
    figure = canvas.new_figure(bottom + (GRAPHS_HEIGHT if curves else 0))
    canvas.write_header(figure, said)
    for k, pair in enumerate(sorted(pairs, key=lambda pair: pair.row)):
        draw_slice(figure, said.height + k * BLOCK, pair, findings.refinement.status)
    draw_graphs(figure, bottom, curves)
    canvas.save(figure, path)


def facts(findings: Findings) -> str:
    """Say what was reconstructed, and how."""
    recorded = findings.reconstructions["recorded"]
    _, height, width = recorded.slices.shape
    text = f"{findings.scan.name} · {findings.scan.n_projections} projections · slices of "
    return f"{text}{width} × {height} px{binning_note(findings)} · {recorded.method}"


def binning_note(findings: Findings) -> str:
    """Say how large a pixel is, where it is not the detector's."""
    binning = findings.scan.binning
    return "" if binning == 1 else f", 1 px = {binning} × {binning} px of the detector"


def draw_slice(figure: Figure, top: float, pair: SlicePair, status: Status) -> None:
    """Draw one slice, `top` inches down the picture: whole above, the zoom below."""
    label = {"fontsize": canvas.TEXT_SIZE, "fontweight": "bold"}
    canvas.write(figure, (canvas.LEFT, top + 0.05), pair.label, label)
    titles = panel_titles(pair, status)
    height, width = pair.inside.shape
    everything = Window(0, 0, max(height, width))
    boxes = [Box(left, top + 0.5, IMAGE, IMAGE) for left in COLUMNS]
    for box, name in zip(boxes, ("recorded", "refined", "difference"), strict=True):
        image = draw_part(figure, box, pair, (name, everything))
        image.axes.set_title(titles[name], **TITLE)
        mark_window(image.axes, pair.window)
        if name != "recorded":
            draw_bar(figure, box, image)
    last = "true" if "true" in pair.images else "difference"
    for left, name in zip(COLUMNS, ("recorded", "refined", last), strict=True):
        box = Box(left, top + IMAGE + 1.12, IMAGE, IMAGE)
        axes = draw_part(figure, box, pair, (name, pair.window)).axes
        axes.set_title(f"{titles[name]}: zoom, {pair.window.side} px", **TITLE)
        mark_edge(axes, pair)
        for spine in axes.spines.values():
            spine.set(color=canvas.MARK, linewidth=1.8)


TITLE: dict[str, Any] = {"fontsize": canvas.TEXT_SIZE, "color": canvas.INK, "pad": 5}


def panel_titles(pair: SlicePair, status: Status) -> dict[str, str]:
    """Name the panels, and say which angles do not stand."""
    unused = "" if status == "accepted" else " (not used)"
    differs = np.any(pair.difference[pair.inside])
    return {
        "recorded": "recorded angles",
        "refined": f"refined angles{unused}",
        "difference": "refined − recorded" if differs else "no difference",
        "true": "true angles",
    }


def draw_part(figure: Figure, box: Box, pair: SlicePair, part: tuple[str, Window]) -> AxesImage:
    """Draw the window of ``part = (name, window)`` at `box`; ticks count px of the slice."""
    name, (top, left, _) = part
    axes = canvas.panel(figure, box)
    shown = pair.difference if name == "difference" else pair.images[name]
    # The corners are outside the field of view: they are left blank.
    seen = part[1].cut(np.where(pair.inside, shown, np.nan))
    height, width = seen.shape
    image = axes.imshow(
        np.ma.masked_invalid(seen),
        extent=(left - 0.5, left + width - 0.5, top + height - 0.5, top - 0.5),
        interpolation="antialiased",
        origin="upper",
        **scale(pair, name),
    )
    axes.locator_params(nbins=5, integer=True)
    axes.tick_params(labelleft=box.left == COLUMNS[0])
    if box.left == COLUMNS[0]:
        axes.set_ylabel("z / px", **canvas.AXIS_LABEL)
    axes.set_xlabel("x / px", **canvas.AXIS_LABEL)
    return image


def scale(pair: SlicePair, name: str) -> dict[str, Any]:
    """Colours of a panel: one grey scale for all slices, zero in the middle for a difference."""
    if name != "difference":
        return {"cmap": "gray", "vmin": pair.limits[0], "vmax": pair.limits[1]}
    size = np.abs(pair.difference[pair.inside])
    size = size[np.isfinite(size)]
    most = float(np.percentile(size, 99.7)) if size.size else 0.0
    # Nothing changed: the scale of the slices themselves, on which nothing is seen.
    most = most if most > 0 else pair.limits[1] - pair.limits[0]
    return {"cmap": "RdBu_r", "vmin": -most, "vmax": most}


def mark_window(axes: Axes, window: Window) -> None:
    """Draw the rectangle that the zoom shows."""
    from matplotlib.patches import Rectangle

    corner = (window.left - 0.5, window.top - 0.5)
    style: dict[str, Any] = {"fill": False, "edgecolor": canvas.MARK, "linewidth": 1.4}
    axes.add_patch(Rectangle(corner, window.side, window.side, **style))


def mark_edge(axes: Axes, pair: SlicePair) -> None:
    """Draw the line that the profile is taken along."""
    if pair.edge is not None:
        z, x = pair.edge.ends
        axes.autoscale(enable=False)
        axes.plot(x, z, color=canvas.MARK, linewidth=1.2)


def draw_bar(figure: Figure, box: Box, image: AxesImage) -> None:
    """Draw the scale of `image` to the right of `box`."""
    place = Box(box.left + box.width + 0.07, box.top, 0.1, box.height)
    bar = figure.colorbar(image, cax=canvas.panel(figure, place), format=canvas.short_numbers())
    bar.ax.tick_params(length=2)
    bar.ax.set_ylabel("attenuation / px", **{**canvas.AXIS_LABEL, "labelpad": 3})
    bar.ax.yaxis.get_offset_text().set(fontsize=canvas.SMALL_SIZE, color=canvas.INK)
    bar.outline.set(edgecolor=canvas.INK, linewidth=0.7)
