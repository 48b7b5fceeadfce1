"""Which modules an entry of a pipeline may name, and what they hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from tomoslam_stage.stages.work import Stage


def nothing(where: str) -> None:
    """Require nothing but what is always installed."""


@dataclass(frozen=True)
class Module:
    """What one ``module_path`` offers."""

    stages: Mapping[str, type[Stage]]
    """By the name of the method."""
    refused: Mapping[str, str] = field(default_factory=dict)
    """Methods that are there but cannot be entries: name -> why."""
    require: Callable[[str], None] = nothing
    """Refuse, for a place in the pipeline, what is not installed."""


Modules: TypeAlias = Mapping[str, Module]
"""By ``module_path``."""
