"""What a study is, and what it leaves: a picture, numbers, and a sentence made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tomoslam_stage.studies.case import Case


class Claim(NamedTuple):
    """A line of the table that sets published values against ours."""

    what: str
    published: str
    reproduced: str
    """By the published method, run here."""
    best: str
    """By ours."""


@dataclass(frozen=True)
class Outcome:
    """What a study found."""

    conclusion: str
    """Sentences made of the numbers."""
    table: Sequence[Mapping[str, Any]]
    """Rows of the CSV file; all have the same keys, which name their units."""
    numbers: Mapping[str, Any]
    """The JSON file: parameters, seeds, and everything the conclusion rests on."""
    claims: Sequence[Claim]
    """What the published experiment says about the same."""
    figure: Figure
    """The picture."""


@runtime_checkable
class Study(Protocol):
    """One published experiment: a frozen dataclass (`methods.method`) of its parameters."""

    fast: ClassVar[Mapping[str, Any]]
    """Parameters with which it takes seconds, to see that it runs."""

    def run(self, case: Case) -> Outcome:
        """Do the experiment on the scan of `case`."""
        ...
