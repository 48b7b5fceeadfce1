"""What can go wrong, each with the exit code that the command line answers with."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

DONE = 0
BUG = 1
KEPT = 4


class StageError(Exception):
    """A refusal a user can act on: ``where: what was found, what was needed; what to do``.

    The command line prints it as one line and ends with ``exit_code``.
    """

    exit_code = BUG

    def __init__(self, where: str, found: str, remedy: str = "") -> None:
        super().__init__(f"{where}: {found}" + (f" {remedy}" if remedy else ""))


class PipelineError(StageError):
    """A pipeline, an option or a parameter that cannot be used."""

    exit_code = 2


class ScanError(StageError):
    """A scan that cannot be read, or whose parts contradict each other."""

    exit_code = 3


class BackendMissingError(StageError):
    """A backend that was chosen by name and is not installed."""

    exit_code = 5


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which of `known` was probably meant, or list them all."""
    names = sorted(known)
    close = get_close_matches(name, names, n=1, cutoff=0.5)
    return f"Did you mean {close[0]!r}?" if close else f"Known: {', '.join(names)}."
