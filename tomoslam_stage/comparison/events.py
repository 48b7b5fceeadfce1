"""Where the stage went wrong, marked on the correction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from tomoslam_stage.comparison import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tomoslam_stage.products import Event, Floats

Side: TypeAlias = Literal["left", "right"]
End: TypeAlias = Literal["top", "bottom"]

MOST_LABELS = 5
"""More would not be read."""
ROOM = 0.022
"""Of the panel's width: labels nearer to each other than this would overlap."""


def draw_events(axes: Axes, along: Floats, change: Floats, events: Sequence[Event]) -> None:
    """Draw a thin line between the two projections of each event, and name the surest of them.

    Parameters
    ----------
    axes
        The panel; its y limits must stand.
    along
        (n,) abscissa of the projections.
    change
        (n,) degrees, the correction that labels keep clear of.
    events
        May be none.
    """
    for event in events:
        style: dict[str, Any] = {"color": canvas.MARK, "linewidth": 0.9, "zorder": 1.5}
        axes.axvline(place(along, event), **style)
    for event in labelled(along, events):
        x, near = place(along, event), change[max(event.projection - 1, 0) : event.projection + 1]
        # To the left of its line, but for a line that has the edge of the panel there.
        side: Side = "right" if x - along.min() > ROOM * np.ptp(along) else "left"
        write_label(axes, x, event, (side, "top" if axes_share(axes, near) < 0.5 else "bottom"))


def place(along: Floats, event: Event) -> float:
    """Abscissa of an event: half way from the projection before it."""
    return float(along[max(event.projection - 1, 0) : event.projection + 1].mean())


def labelled(along: Floats, events: Sequence[Event]) -> list[Event]:
    """Choose the events that get a label: the surest ones, as far as there is room."""
    room = ROOM * float(np.ptp(along))
    chosen: list[Event] = []
    for event in sorted(events, key=lambda event: -event.significance):
        apart = [abs(place(along, event) - place(along, other)) for other in chosen]
        if len(chosen) < MOST_LABELS and min(apart, default=np.inf) > room:
            chosen.append(event)
    return chosen


def axes_share(axes: Axes, values: Floats) -> float:
    """How high up the panel the mean of `values` lies: 0 at the bottom, 1 at the top."""
    low, high = axes.get_ylim()
    return (float(np.mean(values)) - low) / (high - low)


def write_label(axes: Axes, x: float, event: Event, corner: tuple[Side, End]) -> None:
    """Write beside the line at `x`, where the correction may jump, what happened there.

    `corner` of the text, its horizontal and vertical alignment, is at the line's end.
    """
    axes.annotate(
        f"{event.kind} {event.size_deg:+.2f}°".replace("-", "−"),
        (x, 0.98 if corner[1] == "top" else 0.02),
        xytext=(-2 if corner[0] == "right" else 2, 0),
        xycoords=axes.get_xaxis_transform(),
        textcoords="offset points",
        rotation=90,
        ha=corner[0],
        va=corner[1],
        fontsize=canvas.SMALL_SIZE - 1,
        color=canvas.INK,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6},
    )
