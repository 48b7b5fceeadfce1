"""Refined angles as a notebook shows them: a few facts and the correction, in one piece of HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products.arrays import Floats

WIDTH, HEIGHT = 480, 120
POINTS = 400
"""More of them would not be seen."""


def as_html(told: Mapping[str, str], change: Floats, sigma: Floats) -> str:
    """Return a table of what is `told` and a curve; nothing is loaded from anywhere.

    Parameters
    ----------
    told
        By name.
    change
        (n,) degrees: refined minus recorded.
    sigma
        (n,) degrees; NaN where it is not known.
    """
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in told.items()
    )
    return f"<div><table>{cells}</table>{curve(change, sigma)}</div>"


def curve(change: Floats, sigma: Floats) -> str:
    """Draw the correction (n,) and a band of one `sigma` (n,) about it, degrees, as SVG."""
    some = np.unique(np.linspace(0, len(change) - 1, min(POINTS, len(change))).astype(np.intp))
    middle, spread = change[some], np.nan_to_num(sigma[some])
    low, high = float((middle - spread).min()), float((middle + spread).max())
    across = WIDTH * some / max(len(change) - 1, 1)
    scale = (HEIGHT - 2) / max(high - low, 1e-12)

    def points(values: Floats, along: Floats) -> str:
        down = 1 + (high - values) * scale
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(along, down, strict=True))

    band = points(
        np.concatenate([middle + spread, (middle - spread)[::-1]]),
        np.concatenate([across, across[::-1]]),
    )
    said = f"refined minus recorded, {low:.3g} to {high:.3g} degrees, over the projections"
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" role="img"><title>{said}</title>'
        f'<polygon points="{band}" fill="#0072b2" fill-opacity="0.25"/>'
        f'<polyline points="{points(middle, across)}" fill="none" stroke="#0072b2"/></svg>'
        f"<div><small>{said}</small></div>"
    )
