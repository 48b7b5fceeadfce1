"""The two pictures: slices side by side, and the correction of the angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box
from tomoslam_stage.comparison.findings import (
    Findings,
    ResidualChange,
    residual_change,
    row_label,
    rows_word,
    verdict,
)
from tomoslam_stage.comparison.metrics import check_comparable, difference_of_angles
from tomoslam_stage.comparison.regions import (
    Mask,
    Window,
    disc,
    grey_limits,
    material,
    most_changed_window,
    rms,
)
from tomoslam_stage.products import Floats, Pixels, Refinement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_ROWS = 3
"""Slices in one picture."""
IMAGE = 2.68
COLUMNS = (canvas.LEFT, canvas.LEFT + IMAGE + 0.14, canvas.LEFT + 2 * IMAGE + 1.1)
BLOCK = 2 * IMAGE + 1.68
"""Height of all that is drawn of one slice, inches."""
LEAST_SPAN_DEG = 0.01
"""Of the correction's panel, small against the errors of a stage."""
FEW_POINTS = 60
"""Below that each projection gets a dot."""


# -- slices ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class SlicePair:
    """One slice with recorded and with refined angles, and how it is shown."""

    label: str
    images: dict[str, Pixels]
    """(z, x) each: ``recorded``, ``refined`` and, where there is one, ``true``."""
    inside: Mask
    window: Window
    """The part that changed most."""
    limits: tuple[float, float]
    """The grey scale, from recorded and refined together."""

    @property
    def difference(self) -> Pixels:
        """(z, x) refined minus recorded."""
        return self.images["refined"] - self.images["recorded"]


def draw_comparison(path: Path, findings: Findings, rows: Sequence[int] | None = None) -> None:
    """Draw recorded and refined slices, their difference, and the part that changed most.

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
    height, width = pairs[0].inside.shape
    text = f"{findings.scan.name} · {findings.scan.n_projections} projections · slices of "
    text += f"{width} × {height} px" + binning_note(findings)
    said = canvas.header(verdict(findings), [findings.refinement.reason, text])
    figure = canvas.new_figure(said.height + BLOCK * len(pairs))
    canvas.write_header(figure, said)
    for k, pair in enumerate(pairs):
        draw_slice(figure, said.height + k * BLOCK, pair, findings.refinement)
    canvas.save(figure, path)


def binning_note(findings: Findings) -> str:
    """Say how large a pixel is, where it is not the detector's."""
    binning = findings.scan.binning
    return "" if binning == 1 else f", 1 px = {binning} × {binning} px of the detector"


def slice_pairs(findings: Findings, rows: Sequence[int] | None) -> list[SlicePair]:
    """Choose the slices to draw, top row first."""
    made = findings.reconstructions
    missing = {"recorded", "refined"} - set(made)
    if missing:
        raise ValueError(f"no {' and no '.join(sorted(missing))} reconstruction to draw")
    check_comparable(made)
    available = made["recorded"].rows.tolist()
    unknown = sorted(set(rows or ()) - set(available))
    if unknown or not available:
        raise ValueError(f"no slices of the rows {unknown}; there are slices of {available}")
    chosen = most_changed_rows(findings, available if rows is None else rows)
    chosen = sorted(chosen[: 1 if rows is None else MOST_ROWS])
    return [slice_pair(findings, available.index(row)) for row in chosen]


def most_changed_rows(findings: Findings, rows: Sequence[int]) -> list[int]:
    """Sort `rows` by how much their slice changed inside the disc, most changed first."""
    recorded, refined = (findings.reconstructions[name] for name in ("recorded", "refined"))
    inside = disc(recorded.slices.shape[1:])
    place = {int(row): k for k, row in enumerate(recorded.rows)}

    def change(row: int) -> float:
        k = place[row]
        return float(np.nan_to_num(rms((refined.slices[k] - recorded.slices[k])[inside])))

    return sorted(dict.fromkeys(rows), key=change, reverse=True)


def slice_pair(findings: Findings, index: int) -> SlicePair:
    """Prepare slice `index` for drawing."""
    made = findings.reconstructions
    images = {n: made[n].slices[index] for n in ("recorded", "refined", "true") if n in made}
    both = np.stack([images["recorded"], images["refined"]])
    inside = disc(both.shape[1:])
    label = row_label(int(made["recorded"].rows[index]), findings.scan.binning)
    window = most_changed_window((both[1] - both[0]) * material(both[0], inside), inside)
    return SlicePair(label, images, inside, window, grey_limits(both, inside))


def draw_slice(figure: Figure, top: float, pair: SlicePair, refinement: Refinement) -> None:
    """Draw one slice, `top` inches down the picture: whole above, the zoom below."""
    label = {"fontsize": canvas.TEXT_SIZE, "fontweight": "bold"}
    canvas.write(figure, (canvas.LEFT, top + 0.05), pair.label, label)
    titles = panel_titles(pair, refinement)
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
        for spine in axes.spines.values():
            spine.set(color=canvas.MARK, linewidth=1.8)


TITLE: dict[str, Any] = {"fontsize": canvas.TEXT_SIZE, "color": canvas.INK, "pad": 5}
AXIS_LABEL: dict[str, Any] = {"fontsize": canvas.SMALL_SIZE, "color": canvas.INK, "labelpad": 1}


def panel_titles(pair: SlicePair, refinement: Refinement) -> dict[str, str]:
    """Name the panels, and say which angles do not stand."""
    unused = "" if refinement.status == "accepted" else " (not used)"
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
        axes.set_ylabel("z / px", **AXIS_LABEL)
    axes.set_xlabel("x / px", **AXIS_LABEL)
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


def draw_bar(figure: Figure, box: Box, image: AxesImage) -> None:
    """Draw the scale of `image` to the right of `box`."""
    place = Box(box.left + box.width + 0.07, box.top, 0.1, box.height)
    bar = figure.colorbar(image, cax=canvas.panel(figure, place), format=canvas.short_numbers())
    bar.ax.tick_params(length=2)
    bar.ax.set_ylabel("attenuation / px", **AXIS_LABEL)
    bar.ax.yaxis.get_offset_text().set(fontsize=canvas.SMALL_SIZE, color=canvas.INK)
    bar.outline.set(edgecolor=canvas.INK, linewidth=0.7)


# -- angles ----------------------------------------------------------------------------------


def draw_theta(path: Path, findings: Findings) -> None:
    """Draw the correction with its sigma, and below it the residuals of the projections.

    Where no residuals are known the steps between neighbours stand below. A correction that was
    not accepted is drawn too, and marked.
    """
    refinement = findings.refinement
    change = np.degrees(refinement.change)
    text = f"{findings.scan.name} · {len(change)} projections · correction found: "
    text += f"{rms(change):.3g}° rms, {np.abs(change).max(initial=0):.3g}° at most"
    said = canvas.header(verdict(findings), [refinement.reason, text])
    figure = canvas.new_figure(said.height + 5.9)
    canvas.write_header(figure, said)
    left = canvas.LEFT + 0.3
    width = canvas.WIDTH - left - 0.3
    upper = canvas.panel(figure, Box(left, said.height + 0.3, width, 2.6))
    lower = canvas.panel(figure, Box(left, said.height + 3.3, width, 2.0))
    along, label = abscissa(refinement.recorded)
    draw_correction(upper, along, findings)
    draw_residuals_or_steps(lower, along, findings)
    for axes in (upper, lower):
        finish(axes)
    upper.sharex(lower)
    upper.tick_params(labelbottom=False)
    lower.set_xlabel(label, fontsize=canvas.TEXT_SIZE, color=canvas.INK)
    canvas.save(figure, path)


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
    for k, strength in ((2, 0.16), (1, 0.26)):
        band: dict[str, Any] = {"color": canvas.REFINED, "alpha": strength, "linewidth": 0}
        edges = change - k * sigma, change + k * sigma
        axes.fill_between(along, *edges, **band, label=f"± {k} σ")
    draw_verdict_lines(axes, along, refinement)
    if findings.truth is not None:
        wanted = np.degrees(difference_of_angles(findings.truth.theta, refinement.recorded))
        # A common offset of all angles cannot be seen in any scan.
        wanted += np.mean(change - wanted)
        style: dict[str, Any] = {"color": canvas.TRUE, "linestyle": (0, (4, 2)), "linewidth": 1.2}
        axes.plot(along, wanted, **style, label="true correction (same mean)")
    low, high = axes.get_ylim()
    # Nothing but rounding would fill the panel otherwise.
    axes.set_ylim(min(low, -LEAST_SPAN_DEG / 2), max(high, LEAST_SPAN_DEG / 2))
    axes.set_ylabel("refined − recorded / °", fontsize=canvas.TEXT_SIZE, color=canvas.INK)


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
    change = residual_change(findings.comparison)
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
        residual = findings.comparison.residual[name]
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


def finish(axes: Axes) -> None:
    """Add the legend above the panel, where it hides no data, and a light grid."""
    axes.yaxis.set_major_formatter(canvas.short_numbers())
    axes.yaxis.get_offset_text().set(fontsize=canvas.SMALL_SIZE, color=canvas.INK)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=5,
        frameon=False,
        fontsize=canvas.SMALL_SIZE,
        labelcolor=canvas.INK,
        borderaxespad=0.1,
    )
