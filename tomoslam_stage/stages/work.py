"""What the stages of one run hand on, and what makes something a stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, TypeAlias, TypeVar

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.products import Comparison, Reconstructions, Refinement, Scan
from tomoslam_stage.scans import now

SideOutputs: TypeAlias = Mapping[str, float | int | str]
Product = TypeVar("Product")


@dataclass
class Work:
    """One run: where it reads and writes, and the products made so far."""

    path: Path
    """The scan."""
    folder: Path
    """Where the report goes."""
    output: Path | None = None
    """The companion file that gets the angles instead of the scan."""
    dry_run: bool = False
    """Write no angles anywhere."""
    started: str = field(default_factory=now)
    """ISO 8601."""
    seconds: dict[str, float] = field(default_factory=dict)
    """By station: s."""
    pipeline: list[dict[str, Any]] = field(default_factory=list)
    """The pipeline as run, all defaults filled in."""
    scan: Scan | None = None
    refinement: Refinement | None = None
    reconstructions: Reconstructions | None = None
    comparison: Comparison | None = None
    report: Mapping[str, Any] | None = None


class Stage(Protocol):
    """One entry of a pipeline: a frozen dataclass (`methods.method`) of its YAML parameters.

    Class variables tell what it ``needs`` and ``makes`` (products on `Work`), and which side
    outputs it ``gives``.
    """

    def run(self, work: Work) -> SideOutputs:
        """Do the work, leave the product on `work`, and return what other entries may refer to."""
        ...


def made(product: Product | None, name: str) -> Product:
    """Return a product that an earlier stage must have left.

    Raises
    ------
    PipelineError
        If it did not.
    """
    if product is None:
        raise PipelineError("pipeline", f"no entry made the {name}.")
    return product


class Clock:
    """Adds up the seconds of each station."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self.seconds = seconds

    @contextmanager
    def __call__(self, station: str) -> Iterator[None]:
        """Add what the ``with`` block takes to the seconds of `station`."""
        begin = perf_counter()
        yield
        self.seconds[station] = self.seconds.get(station, 0.0) + perf_counter() - begin
