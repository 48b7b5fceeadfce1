"""A curve in one line of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats

BLOCKS = "▁▂▃▄▅▆▇█"
ASCII = "_.-:=+*#"
"""For terminals that know no blocks."""


WIDTH = 48
"""Characters."""


def sparkline(values: Floats, levels: str = BLOCKS) -> str:
    """Draw `values` (n,) from left to right, each at its height between the lowest and the highest.

    Each character is the mean of its share of the values; one without finite values is blank.
    """
    parts = np.array_split(values, min(WIDTH, len(values))) if len(values) else []
    finite = [part[np.isfinite(part)] for part in parts]
    means = np.array([part.mean() if len(part) else np.nan for part in finite])
    if not np.isfinite(means).any():
        return " " * len(means)
    low, high = np.nanmin(means), np.nanmax(means)
    span = high - low if high > low else 1.0
    steps = np.nan_to_num((means - low) / span * len(levels)).astype(int)
    return "".join(
        levels[min(step, len(levels) - 1)] if np.isfinite(mean) else " "
        for step, mean in zip(steps, means, strict=True)
    )
