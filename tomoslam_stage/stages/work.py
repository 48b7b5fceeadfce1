"""What the stages of one run hand on, and what makes something a stage."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, TypeAlias, TypeVar, runtime_checkable

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.products import Comparison, Reconstructions, Refinement, Scan, Tracks
from tomoslam_stage.scans import line_integrals, now

log = logging.getLogger(__name__)

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
    tracks: Tracks | None = None
    """Of the features that gave the angles, px of `scan`; None where there are none."""
    refinement: Refinement | None = None
    reconstructions: Reconstructions | None = None
    comparison: Comparison | None = None
    report: Mapping[str, Any] | None = None

    def line_integrals(self) -> Scan:
        """Return the scan that refinement and reconstruction work on, whatever came before."""
        scan = made(self.scan, "scan")
        if scan.raw is not None:
            log.info("%s: no entry made line integrals of %s; done now", scan.name, scan.values)
            self.scan = line_integrals(scan)
        return made(self.scan, "scan")


class Stage(Protocol):
    """One entry of a pipeline: a frozen dataclass (`methods.method`) of its YAML parameters.

    Class variables tell what it ``needs`` and ``makes`` (products on `Work`), which side outputs
    it ``gives``, and of a scan which values it ``takes`` and may ``leave``.
    """

    def run(self, work: Work) -> SideOutputs:
        """Do the work, leave the product on `work`, and return what other entries may refer to."""
        ...


@runtime_checkable
class Loader(Protocol):
    """A stage that opens the scan."""

    def opened(self, path: Path) -> Scan:
        """Return the scan at `path`."""
        ...


@runtime_checkable
class Fitted(Protocol):
    """A stage whose parameters must fit the scan."""

    def check_fits(self, scan: Scan) -> None:
        """Raise a `PipelineError` where they do not; read no projection."""
        ...


@runtime_checkable
class Writer(Protocol):
    """A stage that writes where something may stand in the way."""

    def check_writable(self, work: Work) -> None:
        """Raise a `ScanError` where it does; this is asked before any work, and after loading."""
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


def check_axis(where: str, axis: float | None, scan: Scan) -> None:
    """Refuse an axis, px of the file, that the detector does not have.

    Raises
    ------
    PipelineError
        If it lies outside.
    """
    last = scan.n_columns * scan.binning - 1
    if axis is not None and not 0 <= axis <= last:
        found = f"{axis:g}; a column between 0 and {last} is needed for {scan.name}."
        raise PipelineError(where, found)


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
