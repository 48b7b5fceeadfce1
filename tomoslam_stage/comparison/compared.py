"""A comparison of slices that can be looked at: for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.comparison import canvas
from tomoslam_stage.comparison.metrics import compare_slices
from tomoslam_stage.comparison.slice_pairs import pair_of
from tomoslam_stage.comparison.slices_picture import BLOCK, draw_slice
from tomoslam_stage.products import Comparison, Reconstruction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tomoslam_stage.products import Pixels


@dataclass(frozen=True)
class Compared(Comparison):
    """A comparison that keeps its slices, and draws them."""

    slices: Mapping[str, Pixels] = field(default_factory=dict)
    """Name -> (r, z, x) attenuation per pixel."""

    def figures(self) -> list[Figure]:
        """Draw each slice: recorded, refined, their difference, and what changed most.

        They are matplotlib figures without pyplot: a notebook shows them, ``savefig`` keeps them.
        """
        return [self._figure(index) for index in range(len(self.slices["recorded"]))]

    def _figure(self, index: int) -> Figure:
        images = {name: np.asarray(slices[index]) for name, slices in self.slices.items()}
        figure = canvas.new_figure(BLOCK + 0.1)
        draw_slice(figure, 0.0, pair_of(images, index, f"slice {index}"), "accepted")
        return figure


def compared(slices: Mapping[str, Pixels]) -> Compared:
    """Compare slices (r, z, x) by name, all of the same rows.

    Raises
    ------
    ValueError
        If they are not of the same shape.
    """
    found = compare_slices(
        {
            name: Reconstruction(np.empty(0), np.nan, np.arange(len(each)), each, "given")
            for name, each in slices.items()
        }
    )
    told = {each.name: getattr(found, each.name) for each in fields(found)}
    return Compared(**told, slices=slices)
