"""The picture of the error ratio: curves over the stepper's noise, and maps over both noises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.studies import panels
from tomoslam_stage.studies.monte_carlo import READINGS, Cell, Grid, SameAccuracy, Sigmas
from tomoslam_stage.studies.panels import ABOVE, BELOW, Words
from tomoslam_stage.studies.published import NOISIER, RATIO, SIGMA_ENCODER, STEP

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomoslam_stage.products import Floats

HEIGHT = 2.7
CURVES = 5
"""At most so many CV noises are drawn as curves."""
RATIO_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
LARGEST = 30.0
"""Ratio with the strongest colour; its inverse has the other."""
TITLES = {"walk": "errors add up", "independent": "independent errors"}
NO_GAIN = {"walk": 1.05, "independent": 1.0}
"""Ratio that a line is drawn at. Where errors add up, the ratio comes down to 1 and stays there."""
APART = 1.9
"""Ratio between two ticks, so that their numbers do not touch."""


@dataclass(frozen=True)
class Points:
    """What was measured on a scan."""

    step_deg: float
    """Of the CV steps below, degrees."""
    sigma_encoder_deg: float
    """Of the recorded steps, degrees."""
    sigma_cv_deg: Mapping[str, float]
    """Way of measuring -> standard deviation of its steps, degrees."""
    expected: Mapping[str, float]
    """Way -> ratio that the Monte Carlo gives for these."""
    ratios: Mapping[str, float]
    """Pipeline -> equation 7."""


def draw(
    grid: Grid,
    same: Mapping[float, SameAccuracy],
    points: Points | None,
    paragraphs: Sequence[str],
) -> Figure:
    """Draw a column for each step size: curves of both averages, then a map for each reading."""
    rows = 1 + len(READINGS)
    title = "Error ratio: what the factor graph gains (the paper's Figure 6 and equation 7)"
    spacing = HEIGHT + ABOVE + BELOW
    figure, top = panels.sheet(title, paragraphs, rows * spacing + 0.5)
    for box, (step, found) in zip(
        panels.columns_of(len(same), top, HEIGHT), same.items(), strict=True
    ):
        words = Words(
            f"{step:g} degree CV factors, errors add up",
            "solid: ratio of means; dotted: mean of ratios",
            "σ of the stepper / degrees a step",
            "error ratio (eq. 7)",
        )
        axes = panels.named_panel(figure, box, words)
        draw_curves(axes, grid, step, found)
        if step == STEP:
            draw_points(axes, points)
    for k, reading in enumerate(READINGS, start=1):
        boxes = panels.columns_of(len(same), top + k * spacing + 0.15, HEIGHT)
        for box, step in zip(boxes, same, strict=True):
            words = Words(
                f"{step:g} degrees, {TITLES[reading]}",
                f"ratio of means; lines: {NO_GAIN[reading]:g} and {RATIO}",
                "σ of the stepper / degrees",
                "σ of the CV steps / degrees",
            )
            axes = panels.named_panel(figure, box, words)
            draw_map(axes, grid, (reading, step))
            if points is not None and step == points.step_deg:
                mark_measured(axes, points)
    return figure


def draw_curves(axes: Axes, grid: Grid, step: float, found: SameAccuracy) -> None:
    """Draw equation 7 over the stepper's noise, a curve for each CV noise."""
    from matplotlib import colormaps

    sigmas_cv, encoder = axes_of(grid)
    chosen = sigmas_cv[np.unique(np.linspace(0, len(sigmas_cv) - 1, CURVES).astype(int))]
    colours = colormaps["viridis"](np.linspace(0, 0.85, len(chosen)))
    for cv, colour in zip(chosen, colours, strict=True):
        cells = [grid[Cell("walk", step, Sigmas(cv, sigma))] for sigma in encoder]
        style: dict[str, Any] = {"color": colour, "linewidth": 1.3}
        axes.plot(encoder, [r.of_means for r in cells], **style, label=f"σ CV {cv:g}")
        axes.plot(encoder, [r.mean for r in cells], **{**style, "linestyle": ":"})
    if found.curve:
        label = f"{SIGMA_ENCODER} alone / graph, σ CV {found.sigma_cv_deg:.2g}"
        style = {"color": canvas.INK, "linewidth": 1.3, "linestyle": "--"}
        axes.plot(list(found.curve), list(found.curve.values()), **style, label=label)
    axes.axhline(1, color=canvas.INK, linewidth=0.7)
    axes.set(xscale="log", yscale="log")
    panels.plain_ticks(axes, "x", spaced(encoder))
    panels.plain_ticks(axes, "y", RATIO_TICKS)
    highest = max(r.of_means for cell, r in grid.items() if cell.reading == "walk")
    axes.set_ylim(0.04, 40 * highest)
    panels.legend(axes, 6.5, loc="upper left")


def draw_points(axes: Axes, points: Points | None) -> None:
    """Mark what was published, and what was measured, with a legend of its own."""
    curves = axes.get_legend()
    mark: dict[str, Any] = {"color": canvas.TRUE, "markersize": 8, "linestyle": "none"}
    marks = axes.plot([SIGMA_ENCODER], [RATIO], marker="*", **mark, label=f"published: {RATIO}")
    mark |= {"markersize": 7, "markerfacecolor": "none"}
    label = f"published: {NOISIER} times noisier, same accuracy"
    marks += axes.plot([NOISIER * SIGMA_ENCODER], [1], marker="*", **mark, label=label)
    if points is not None:
        marks += draw_measured(axes, points)
    panels.legend(axes, 6.5, loc="lower left", handles=marks)
    if curves is not None:
        axes.add_artist(curves)


def draw_measured(axes: Axes, points: Points) -> list[Any]:
    """Mark what the pipelines reached, and return the marks."""
    mark: dict[str, Any] = {"color": canvas.REFINED, "markersize": 6, "linestyle": "none"}
    marks: list[Any] = []
    for marker, (pipeline, ratio) in zip("sD", points.ratios.items(), strict=True):
        label = f"measured, pipeline {pipeline}: {ratio:.2g}"
        marks += axes.plot([points.sigma_encoder_deg], [ratio], marker, **mark, label=label)
    return marks


def draw_map(axes: Axes, grid: Grid, which: tuple[str, float]) -> None:
    """Draw the ratio of means over both noises, white where it is 1."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import NullLocator

    cv, encoder = axes_of(grid)
    ratios = np.array([[grid[Cell(*which, Sigmas(c, e))].of_means for e in encoder] for c in cv])
    norm = LogNorm(1 / LARGEST, LARGEST)
    image = axes.pcolormesh(borders(encoder), borders(cv), ratios, norm=norm, cmap="RdBu")
    axes.set(xscale="log", yscale="log")
    panels.plain_ticks(axes, "x", spaced(encoder))
    panels.plain_ticks(axes, "y", cv.tolist())
    axes.grid(visible=False)
    levels = [level for level in (NO_GAIN[which[0]], RATIO) if ratios.min() < level < ratios.max()]
    if levels:
        lines = axes.contour(encoder, cv, ratios, levels=levels, colors=canvas.INK, linewidths=1)
        axes.clabel(lines, fmt="%g", fontsize=canvas.SMALL_SIZE)
    bar = axes.figure.colorbar(image, ax=axes, fraction=0.06, pad=0.03)
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.set_ticks([0.1, 1, 10], labels=["0.1", "1", "10"])
    bar.ax.tick_params(labelsize=canvas.SMALL_SIZE, length=2)


def spaced(sigmas: Floats) -> list[float]:
    """Return those of `sigmas` (k,) that can be named without their names touching."""
    kept = [float(sigmas[0])]
    for sigma in sigmas[1:]:
        if sigma >= APART * kept[-1]:
            kept.append(float(sigma))
    return kept


def borders(sigmas: Floats) -> Floats:
    """(k + 1,) where the cells of `sigmas` (k,) meet on a logarithmic axis, and where they end."""
    middles = np.sqrt(sigmas[1:] * sigmas[:-1])
    first, last = sigmas[0] ** 2 / middles[0], sigmas[-1] ** 2 / middles[-1]
    return np.concatenate([[first], middles, [last]])


def mark_measured(axes: Axes, points: Points) -> None:
    """Mark where both noises were measured, where that lies in the map."""
    low, high = axes.get_ylim()
    left, right = axes.get_xlim()
    for marker, (name, sigma) in zip("sD", points.sigma_cv_deg.items(), strict=True):
        if low <= sigma <= high and left <= points.sigma_encoder_deg <= right:
            mark: dict[str, Any] = {"color": canvas.MARK, "markeredgecolor": canvas.INK}
            place = points.sigma_encoder_deg, sigma
            axes.plot(*place, marker, **mark)
            beside: dict[str, Any] = {"xytext": (7, 0), "textcoords": "offset points"}
            said = f"{name.partition(',')[0]}, measured"
            axes.annotate(said, place, **beside, va="center", fontsize=canvas.SMALL_SIZE)


def axes_of(grid: Grid) -> tuple[Floats, Floats]:
    """Return all CV noises and all noises of the stepper, degrees."""
    return (
        np.unique([cell.sigmas.cv for cell in grid]),
        np.unique([cell.sigmas.encoder for cell in grid]),
    )
