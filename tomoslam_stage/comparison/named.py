"""The named set of reconstructions: which are whole, and which are the halves of one."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tomoslam_stage.products import Reconstruction, Reconstructions

NAMES = ("recorded", "refined", "true")
"""Of the reconstructions from all projections, in the order in which they are shown."""
HALVES = ("_even", "_odd")
"""What the name ends with where every other projection alone was used."""


def wholes(reconstructions: Reconstructions) -> dict[str, Reconstruction]:
    """Those from all projections."""
    return {name: reconstructions[name] for name in NAMES if name in reconstructions}


def halved(reconstructions: Reconstructions) -> dict[str, tuple[Reconstruction, Reconstruction]]:
    """Both halves of those that have both."""
    pairs = {name: [reconstructions.get(name + ending) for ending in HALVES] for name in NAMES}
    return {name: (even, odd) for name, (even, odd) in pairs.items() if even and odd}


def check_comparable(reconstructions: Reconstructions) -> None:
    """Refuse slices that do not lie over each other.

    Raises
    ------
    ValueError
        If rows or sizes differ.
    """
    kinds = {
        (tuple(made.rows.tolist()), made.slices.shape): name
        for name, made in reconstructions.items()
    }
    if len(kinds) > 1:
        found = "; ".join(f"{name}: rows {rows}, {shape}" for (rows, shape), name in kinds.items())
        raise ValueError(f"slices of the same rows and size are needed, found {found}")
