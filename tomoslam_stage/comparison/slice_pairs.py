"""The slices that are drawn: which, how bright, and which part of them is enlarged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.comparison.edges import Edge, most_changed_edge
from tomoslam_stage.comparison.findings import Findings, row_label
from tomoslam_stage.comparison.named import check_comparable, wholes
from tomoslam_stage.comparison.regions import (
    Mask,
    Window,
    disc,
    grey_limits,
    most_changed_first,
    most_changed_material,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tomoslam_stage.products import Pixels

MOST_ROWS = 3
"""Slices in one picture."""


@dataclass(frozen=True)
class SlicePair:
    """One slice with recorded and with refined angles, and how it is shown."""

    row: int
    """Detector row."""
    label: str
    images: dict[str, Pixels]
    """(z, x) each: ``recorded``, ``refined`` and, where there is one, ``true``."""
    inside: Mask
    window: Window
    """The part that changed most."""
    edge: Edge | None
    """The edge that changed most, where one did."""
    limits: tuple[float, float]
    """The grey scale, from recorded and refined together."""

    @property
    def difference(self) -> Pixels:
        """(z, x) refined minus recorded."""
        return self.images["refined"] - self.images["recorded"]


def slice_pairs(findings: Findings, rows: Sequence[int] | None) -> list[SlicePair]:
    """Choose the slices to draw, the most changed first."""
    made = wholes(findings.reconstructions)
    missing = {"recorded", "refined"} - set(made)
    if missing:
        raise ValueError(f"no {' and no '.join(sorted(missing))} reconstruction to draw")
    check_comparable(made)
    available = made["recorded"].rows.tolist()
    unknown = sorted(set(rows or ()) - set(available))
    if unknown or not available:
        raise ValueError(f"no slices of the rows {unknown}; there are slices of {available}")
    asked = [available.index(row) for row in dict.fromkeys(available if rows is None else rows)]
    order = most_changed_first(*(made[name].slices[asked] for name in ("recorded", "refined")))
    chosen = [asked[k] for k in order[: 1 if rows is None else MOST_ROWS]]
    return [slice_pair(findings, index) for index in chosen]


def slice_pair(findings: Findings, index: int) -> SlicePair:
    """Prepare slice `index` for drawing."""
    made = wholes(findings.reconstructions)
    images = {name: one.slices[index] for name, one in made.items()}
    row = int(made["recorded"].rows[index])
    return pair_of(images, row, row_label(row, findings.scan.binning))


def pair_of(images: dict[str, Pixels], row: int, label: str) -> SlicePair:
    """Find what changed most between ``recorded`` and ``refined`` slices (z, x)."""
    recorded, refined = images["recorded"], images["refined"]
    inside = disc(recorded.shape)
    window = most_changed_material(recorded, refined, inside)
    return SlicePair(
        row=row,
        label=label,
        images=images,
        inside=inside,
        window=window,
        edge=most_changed_edge(recorded, refined, inside, window),
        limits=grey_limits(np.stack([recorded, refined]), inside),
    )
