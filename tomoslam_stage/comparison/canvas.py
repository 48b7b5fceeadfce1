"""An empty picture, panels placed in inches on it, and its way into a file.

Everything matplotlib would look up in its global settings is said here, so that a picture does not
depend on the style of the notebook it is made in, and pyplot is never touched.
"""

from __future__ import annotations

import textwrap
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

from tomoslam_stage.comparison.writing import write_atomically

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

DPI = 150
WIDTH = 1600 / DPI
LEFT = 0.62
INK, FAINT = "#1a1a1a", "#8c8c8c"
RECORDED, REFINED, TRUE, MARK = "#8c8c8c", "#0072b2", "#d55e00", "#e69f00"
"""Told apart by colour-blind readers, and in print."""
TITLE_SIZE, TEXT_SIZE, SMALL_SIZE = 12.5, 9.5, 8.5
AXIS_LABEL: dict[str, Any] = {"fontsize": SMALL_SIZE, "color": INK, "labelpad": 1}
TITLE_CHARACTERS, TEXT_CHARACTERS = 92, 136


class Box(NamedTuple):
    """Where a panel lies, inches from the upper left corner of the picture."""

    left: float
    top: float
    width: float
    height: float


def new_figure(height: float) -> Figure:
    """Make a white picture of the common width and `height` inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), dpi=DPI, facecolor="white", edgecolor="white")
    FigureCanvasAgg(figure)
    return figure


def panel(figure: Figure, box: Box) -> Axes:
    """Add axes at `box`."""
    width, height = figure.get_size_inches()
    bottom = 1 - (box.top + box.height) / height
    place = (box.left / width, bottom, box.width / width, box.height / height)
    axes = figure.add_axes(place, facecolor="white")
    axes.tick_params(colors=INK, labelsize=SMALL_SIZE, direction="out", length=3)
    for spine in axes.spines.values():
        spine.set(color=INK, linewidth=0.7)
    return axes


def short_numbers() -> ScalarFormatter:
    """Make tick labels short enough for their margin: the power of ten stands above the axis."""
    from matplotlib.ticker import ScalarFormatter

    numbers = ScalarFormatter(useMathText=True, useOffset=False)
    numbers.set_powerlimits((-2, 3))
    return numbers


def finish(axes: Axes, **legend: Any) -> None:
    """Add the legend outside the panel, where it hides no data, and a light grid."""
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    style: dict[str, Any] = {"frameon": False, "fontsize": SMALL_SIZE, "labelcolor": INK}
    axes.legend(borderaxespad=0.1, **style, **legend)


class Header(NamedTuple):
    """What stands above the panels: a title sentence and what is said in small below it."""

    title: Sequence[str]
    text: Sequence[str]

    @property
    def height(self) -> float:
        """Inches down to the first panel."""
        return 0.24 + 0.25 * len(self.title) + 0.19 * len(self.text)


def header(title: str, paragraphs: Sequence[str]) -> Header:
    """Break all that is said into lines that fit."""
    text = [line for words in paragraphs for line in textwrap.wrap(words, TEXT_CHARACTERS)]
    return Header(textwrap.wrap(title, TITLE_CHARACTERS), text)


def write_header(figure: Figure, said: Header) -> None:
    """Put `said` into the upper left corner."""
    top = 0.14
    for line in said.title:
        write(figure, (LEFT, top), line, {"fontsize": TITLE_SIZE, "fontweight": "bold"})
        top += 0.25
    for line in said.text:
        write(figure, (LEFT, top + 0.03), line, {"fontsize": TEXT_SIZE})
        top += 0.19


def write(figure: Figure, place: tuple[float, float], text: str, style: dict[str, Any]) -> None:
    """Write `text` with its upper left corner at `place`, inches from the upper left."""
    width, height = figure.get_size_inches()
    x, y = place[0] / width, 1 - place[1] / height
    # A file may be called a$b$c.h5: what users name is never read as mathematics.
    words = figure.text(x, y, text, parse_math=False, va="top", ha="left")
    words.set(**{"color": INK, **style})


def save(figure: Figure, path: Path, dots_per_inch: float = DPI) -> None:
    """Write `figure` to `path` as PNG, which prints with so many of its pixels in an inch."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    content = BytesIO()
    # Not savefig: that one crops where a notebook's settings say so.
    print_png: Any = FigureCanvasAgg(figure).print_png
    print_png(content, pil_kwargs={"dpi": (dots_per_inch, dots_per_inch)})
    write_atomically(path, content.getvalue())
