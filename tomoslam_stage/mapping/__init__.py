"""The reconstruction itself as a source of angle measurements: the map factor."""

from tomoslam_stage.mapping.looking import Look
from tomoslam_stage.mapping.mapping import Mapped, Mapping
from tomoslam_stage.mapping.placing import Made, Placing

__all__ = ["Look", "Made", "Mapped", "Mapping", "Placing"]
