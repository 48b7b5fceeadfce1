"""The reconstruction itself as a source of angle measurements: the map factor."""

from tomoslam_stage.mapping.mapping import Mapped, Mapping
from tomoslam_stage.mapping.stepping import Solve

__all__ = ["Mapped", "Mapping", "Solve"]
