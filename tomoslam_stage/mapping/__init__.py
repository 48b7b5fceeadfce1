"""The reconstruction itself as a source of angle measurements: the map factor."""

from tomoslam_stage.mapping.mapping import Mapped, Mapping

__all__ = ["Mapped", "Mapping"]
