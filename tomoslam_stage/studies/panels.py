"""Panels of the studies' pictures, in the style of the comparison's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.canvas import Box

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ABOVE = 0.55
"""Inches above a panel, for its title and remark."""
BELOW = 0.62
"""Inches below a panel, for its ticks and label."""
LEFT, GAP, RIGHT = canvas.LEFT + 0.2, 0.75, 0.3


class Words(NamedTuple):
    """What is written round a panel."""

    title: str
    remark: str
    """Said below the title, in small."""
    x: str
    y: str


def sheet(title: str, paragraphs: Sequence[str], height: float) -> tuple[Figure, float]:
    """Make a picture with a header and room of `height` inches below it, and say where that is."""
    said = canvas.header(title, paragraphs)
    figure = canvas.new_figure(said.height + 0.15 + height)
    canvas.write_header(figure, said)
    return figure, said.height + 0.15


def columns_of(count: int, top: float, height: float) -> list[Box]:
    """Places of `count` panels side by side, `height` inches each, their titles from `top` on."""
    width = (canvas.WIDTH - LEFT - RIGHT - (count - 1) * GAP) / count
    return [Box(LEFT + k * (width + GAP), top + ABOVE, width, height) for k in range(count)]


def named_panel(figure: Figure, box: Box, words: Words) -> Axes:
    """Add a panel with a title, a remark and its labels."""
    canvas.write(figure, (box.left, box.top - ABOVE), words.title, {"fontsize": canvas.TEXT_SIZE})
    remark = {"fontsize": canvas.SMALL_SIZE, "color": canvas.FAINT}
    canvas.write(figure, (box.left, box.top - ABOVE + 0.2), words.remark, remark)
    axes = canvas.panel(figure, box)
    axes.set_xlabel(words.x, **canvas.AXIS_LABEL)
    axes.set_ylabel(words.y, **canvas.AXIS_LABEL)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    return axes


def plain_ticks(axes: Axes, along: str, places: Sequence[float]) -> None:
    """Put plain numbers at `places` of the axis ``x`` or ``y``, and nowhere else."""
    from matplotlib.ticker import NullLocator

    axis = axes.xaxis if along == "x" else axes.yaxis
    axis.set_ticks(list(places), [f"{place:g}" for place in places])
    axis.set_minor_locator(NullLocator())


def legend(axes: Axes, size: float = canvas.SMALL_SIZE, **where: Any) -> None:
    """Add a legend without a frame."""
    axes.legend(frameon=False, fontsize=size, labelcolor=canvas.INK, **where)


def listed(values: Sequence[float]) -> str:
    """Write numbers as in a sentence: ``4, 5 and 10``; ``none`` where there are none."""
    words = [f"{value:g}" for value in values]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words) or "none"
