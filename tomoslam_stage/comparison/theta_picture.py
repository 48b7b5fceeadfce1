"""The picture of the angles: the correction, and the residuals of the projections."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box
from tomoslam_stage.comparison.events import draw_events
from tomoslam_stage.comparison.findings import (
    Findings,
    ResidualChange,
    gauge,
    residual_change,
    rows_word,
    verdict,
)
from tomoslam_stage.comparison.histograms import (
    HISTOGRAMS_HEIGHT,
    draw_histograms,
    histograms_of,
)
from tomoslam_stage.comparison.metrics import difference_of_angles
from tomoslam_stage.comparison.regions import rms
from tomoslam_stage.comparison.shifts import shifts_of
from tomoslam_stage.products import Floats, Refinement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_SPAN_DEG = 0.01
"""Of the correction's panel, small against the errors of a stage."""
FEW_POINTS = 60
"""Below that each projection gets a dot."""
TRUE_LINE: dict[str, Any] = {"color": canvas.TRUE, "linestyle": (0, (4, 2)), "linewidth": 1.2}
ABOVE, BELOW = 0.3, 0.6
"""Inches above the first and below the last panel over all projections."""
PANEL_GAP = 0.4
"""Inches between two of them."""

Drawing: TypeAlias = Callable[["Axes", Floats, Findings], None]
"""Draws one panel along an abscissa (n,)."""


def draw_theta(path: Path, findings: Findings) -> None:
    """Draw the correction with its sigma, and below it the residuals of the projections.

    Shifts of the projections stand between the two, where they were looked for. Lapses of the
    stage are marked. Where no residuals are known the steps between neighbours stand
    in their place. A correction that was not accepted is drawn too, and marked. Histograms of the
    tracks follow where features were placed, and in the foot what no scan tells about its angles.
    """
    refinement = findings.refinement
    change = np.degrees(refinement.change)
    text = f"{findings.scan.name} · {len(change)} projections · correction found: "
    text += f"{rms(change):.3g}° rms, {np.abs(change).max(initial=0):.3g}° at most"
    said = canvas.header(verdict(findings), [refinement.reason, text])
    histograms = histograms_of(refinement)
    foot = textwrap.wrap(gauge(refinement), canvas.TEXT_CHARACTERS)
    panels = panels_of(findings, (2.6, 1.3))
    panels.append((2.0, draw_residuals_or_steps))
    below = said.height + height_of(panels)
    bottom = below + (HISTOGRAMS_HEIGHT if histograms else 0)
    figure = canvas.new_figure(bottom + 0.2 * len(foot) + (0.1 if foot else 0))
    canvas.write_header(figure, said)
    draw_panels(figure, said.height, findings, panels)
    draw_histograms(figure, below, histograms)
    for k, line in enumerate(foot):
        style = {"fontsize": canvas.SMALL_SIZE, "color": canvas.FAINT}
        canvas.write(figure, (canvas.LEFT, bottom + 0.05 + 0.2 * k), line, style)
    canvas.save(figure, path)


def panels_of(findings: Findings, heights: tuple[float, float]) -> list[tuple[float, Drawing]]:
    """Choose the panels of what was found, correction and shifts, with their `heights`, inches."""
    panels: list[tuple[float, Drawing]] = [(heights[0], draw_correction)]
    if findings.refinement.shift is not None:
        panels.append((heights[1], draw_shifts))
    return panels


def height_of(panels: Sequence[tuple[float, Drawing]]) -> float:
    """Inches of panels below each other, with what stands around them."""
    heights = [height for height, _ in panels]
    return ABOVE + sum(heights) + PANEL_GAP * (len(heights) - 1) + BELOW


def draw_panels(
    figure: Figure, top: float, findings: Findings, panels: Sequence[tuple[float, Drawing]]
) -> None:
    """Draw panels over all projections below each other, `top` inches down the picture."""
    left = canvas.LEFT + 0.3
    along, label = abscissa(findings.refinement.recorded)
    top, drawn = top + ABOVE, []
    for height, draw in panels:
        axes = canvas.panel(figure, Box(left, top, canvas.WIDTH - left - 0.3, height))
        draw(axes, along, findings)
        axes.yaxis.set_major_formatter(canvas.short_numbers())
        axes.yaxis.get_offset_text().set(fontsize=canvas.SMALL_SIZE, color=canvas.INK)
        canvas.finish(axes, loc="lower right", bbox_to_anchor=(1, 1), ncols=5)
        drawn.append(axes)
        top += height + PANEL_GAP
    for axes in drawn[:-1]:
        axes.sharex(drawn[-1])
        axes.tick_params(labelbottom=False)
    drawn[-1].set_xlabel(label, fontsize=canvas.TEXT_SIZE, color=canvas.INK)


def abscissa(recorded: Floats) -> tuple[Floats, str]:
    """Count along the recorded angles where they grow or fall steadily, else along the scan."""
    steps = np.diff(recorded)
    if np.all(steps > 0) or np.all(steps < 0):
        return np.degrees(recorded), "recorded angle / °"
    return np.arange(len(recorded), dtype=float), "projection"


def draw_correction(axes: Axes, along: Floats, findings: Findings) -> None:
    """Draw refined minus recorded, its band, and the true correction where it is known."""
    refinement = findings.refinement
    change, sigma = np.degrees(refinement.change), np.degrees(refinement.sigma)
    draw_band(axes, along, change, sigma)
    draw_verdict_lines(axes, along, refinement)
    if findings.truth is not None:
        wanted = np.degrees(difference_of_angles(findings.truth.theta, refinement.recorded))
        # A common offset of all angles cannot be seen in any scan.
        wanted += np.mean(change - wanted)
        axes.plot(along, wanted, **TRUE_LINE, label="true correction (same mean)")
    low, high = axes.get_ylim()
    # Nothing but rounding would fill the panel otherwise.
    axes.set_ylim(min(low, -LEAST_SPAN_DEG / 2), max(high, LEAST_SPAN_DEG / 2))
    draw_events(axes, along, change, refinement.events)
    axes.set_ylabel("refined − recorded / °", fontsize=canvas.TEXT_SIZE, color=canvas.INK)


def draw_band(axes: Axes, along: Floats, middle: Floats, sigma: Floats) -> None:
    """Draw one and two `sigma` (n,) about `middle` (n,)."""
    for k, strength in ((2, 0.16), (1, 0.26)):
        band: dict[str, Any] = {"color": canvas.REFINED, "alpha": strength, "linewidth": 0}
        edges = middle - k * sigma, middle + k * sigma
        axes.fill_between(along, *edges, **band, label=f"± {k} σ")


def draw_shifts(axes: Axes, along: Floats, findings: Findings) -> None:
    """Draw how far each projection lies to the right, and how far in truth where it is known."""
    shifts = shifts_of(findings)
    if shifts is None:
        return
    if np.isfinite(shifts.sigma).any():
        draw_band(axes, along, shifts.found, shifts.sigma)
    axes.axhline(0, color=canvas.INK, linewidth=0.8)
    used = "" if findings.refinement.status == "accepted" else " found, not used"
    line = {"color": canvas.REFINED, **stroke(along, 1.2)}
    axes.plot(along, shifts.found, **line, label=f"shift{used}, rms {rms(shifts.found):.2g} px")
    if shifts.true is not None:
        axes.plot(along, shifts.true, **TRUE_LINE, label="true shift")
    axes.set_ylabel("shift / px", fontsize=canvas.TEXT_SIZE, color=canvas.INK)


def draw_verdict_lines(axes: Axes, along: Floats, refinement: Refinement) -> None:
    """Draw the correction and the zero line, the stronger of which are the angles that stand."""
    change = np.degrees(refinement.change)
    if refinement.status == "accepted":
        axes.axhline(0, color=canvas.INK, linewidth=0.8)
        label, strength = "correction", 1.0
    else:
        axes.axhline(0, color=canvas.INK, linewidth=1.8, label="recorded angles: these stand")
        label, strength = "correction found, not used", 0.55
    if not change.any():
        label = "no correction found"
    line = {"color": canvas.REFINED, "alpha": strength, **stroke(along, 1.5)}
    axes.plot(along, change, **line, label=label)


def draw_residuals_or_steps(axes: Axes, along: Floats, findings: Findings) -> None:
    """Draw the residual of each projection, or how the steps changed where none are known."""
    change = residual_change(findings.refinement)
    if np.isfinite(change.percent):
        draw_residuals(axes, along, findings, change)
    else:
        draw_steps(axes, along, findings.refinement)


def draw_residuals(axes: Axes, along: Floats, findings: Findings, change: ResidualChange) -> None:
    """Draw the reprojection residual of each projection with both sets of angles."""
    both = {"recorded": change.recorded, "refined": change.refined}
    colours = {"recorded": canvas.RECORDED, "refined": canvas.REFINED}
    for name, value in both.items():
        line = {"color": colours[name], **stroke(along, 1.0)}
        residual = findings.refinement.reprojection[name]
        axes.plot(along, residual, **line, label=f"{name} angles, rms {value:.4g}")
    where = rows_word(findings.refinement.heldout_rows)
    axes.set_ylabel(f"reprojection residual,\n{where}", fontsize=canvas.TEXT_SIZE, color=canvas.INK)


def draw_steps(axes: Axes, along: Floats, refinement: Refinement) -> None:
    """Draw how much each step between neighbours changed."""
    steps = np.degrees(np.diff(refinement.change))
    line = {"color": canvas.REFINED, **stroke(along, 1.0)}
    axes.plot(along[1:], steps, **line, label="refined − recorded step to the previous projection")
    axes.set_ylabel("change of step / °", fontsize=canvas.TEXT_SIZE, color=canvas.INK)


def stroke(along: Floats, width: float) -> dict[str, Any]:
    """Lines, with dots where there are few points; a single point would not be seen else."""
    dots = {"marker": "o", "markersize": 3.5} if len(along) <= FEW_POINTS else {}
    return {"linewidth": width, **dots}
