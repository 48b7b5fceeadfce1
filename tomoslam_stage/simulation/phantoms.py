"""The phantoms, by the name a recipe calls them.

To add one: a file with a method whose `solids` draws it in the field of `placing`, and a line here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from tomoslam_stage.simulation.bodies import Solids
from tomoslam_stage.simulation.card import Card
from tomoslam_stage.simulation.foam import Foam
from tomoslam_stage.simulation.grains import Grains
from tomoslam_stage.simulation.smooth import Smooth


@runtime_checkable
class Phantom(Protocol):
    """Something to scan."""

    def solids(self) -> tuple[Solids, ...]:
        """Its parts, drawn in a field of radius `FIELD_RADIUS`."""
        ...


PHANTOMS: Mapping[str, type[Phantom]] = {
    "card": Card,
    "grains": Grains,
    "smooth": Smooth,
    "foam": Foam,
}
