"""tomopy's functions for projections as stages: Scan -> Scan with other values.

As in HTTomo the first parameter of a function receives the projections; flats, darks, angles and
the number of cores are filled in, and what is left are the parameters of the entry.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from inspect import Parameter
from typing import Any, ClassVar

import numpy as np

from tomoslam_stage import scans, tomopy_adapter
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import method
from tomoslam_stage.products import Integers, Pixels, ProjectionSource, Scan, Values
from tomoslam_stage.stages.work import SideOutputs, Stage, Work, made

log = logging.getLogger(__name__)

TAKES: Mapping[str, tuple[Values, ...]] = {
    "normalize": ("counts",),
    "normalize_bg": ("counts", "transmission"),
    "normalize_roi": ("counts", "transmission"),
    "minus_log": ("transmission",),
    "retrieve_phase": ("transmission",),
}
"""Function -> values it makes sense on, where not on all."""
LEAVES: Mapping[str, Values] = {
    "normalize": "transmission",
    "normalize_bg": "transmission",
    "normalize_roi": "transmission",
    "minus_log": "line_integrals",
}
"""Function -> values it makes, where it makes others than it took."""
HALF_TURN_DEG, TOLERATED_DEG = 180.0, 10.0
ONLY_HALF = (
    "%s expects half a turn, and %s spans %.4g degrees: its axis may be far off; "
    "refine_theta finds the axis of any scan"
)
MIDDLE = (None, "mid")
"""What stands for the middle row; the latter as HTTomo has it."""


class TomopyFunction:
    """What all of them share; `stage_of` makes the class of one, which has its parameters."""

    needs: ClassVar = ("scan",)
    gives: ClassVar[tuple[str, ...]] = ()
    module_path: ClassVar[str]
    function: ClassVar[str]

    def run(self, work: Work) -> SideOutputs:
        """Leave the scan with prepared values, or return what the function found."""
        scan = made(work.scan, "scan")
        self._check_takes(scan)
        if self.gives:
            return self._found(scan)
        along = tomopy_adapter.along(self.module_path, self.function, self.parameters())

        def prepare(block: Pixels, rows: Integers) -> Pixels:
            return np.asarray(self._called(block, scan, rows))

        spool = scans.spooled(scan.source, prepare, along, self.function, work.folder)
        work.scan = scans.prepared(scan, spool, LEAVES.get(self.function, scan.values))
        return {}

    def check_fits(self, scan: Scan) -> None:
        """Refuse a row that the scan does not have, and flats that it lacks."""
        if self.gives:
            self._row(scan)
        if "flat" in self._filled() and scan.raw is not None and scan.raw.flats is None:
            raise PipelineError(self.function, f"{scan.name} has no flats, which it needs.")

    def parameters(self) -> dict[str, Any]:
        """Return what the entry says, by the names of the function's parameters."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def _check_takes(self, scan: Scan) -> None:
        takes = TAKES.get(self.function, (scan.values,))
        if scan.values not in takes:
            needed = f"{' or '.join(takes)} are needed."
            found = f"{scan.name} gives {scan.values} here; {needed}".replace("_", " ")
            raise PipelineError(self.function, found, "Leave the entry out.")
        self.check_fits(scan)

    def _filled(self) -> frozenset[str]:
        return tomopy_adapter.fills(self.module_path, self.function)

    def _called(self, block: Pixels, scan: Scan, rows: Integers) -> Pixels | float:
        """Call the function on a block that holds `rows` (r,) of the scan."""
        sources = {} if scan.raw is None else {"flat": scan.raw.flats, "dark": scan.raw.darks}
        filled: dict[str, Any] = {
            name: frames(sources.get(name), block.shape, rows)
            for name in self._filled() & {"flat", "dark"}
        }
        if "theta" in self._filled():
            filled["theta"] = scan.theta
        return tomopy_adapter.call(
            self.module_path, self.function, block, **self.parameters(), **filled
        )

    def _found(self, scan: Scan) -> SideOutputs:
        span = float(np.degrees(np.ptp(scan.theta)))
        if span > HALF_TURN_DEG + TOLERATED_DEG:
            log.warning(ONLY_HALF, self.function, scan.name, span)
        rows = np.array([self._row(scan)])
        block = scan.source.read(np.arange(scan.n_projections), rows)
        number = float(self._called(block, scan, rows))
        return dict.fromkeys(self.gives, scan.column_in_file(number))

    def _row(self, scan: Scan) -> int:
        row = self.parameters().get("ind")
        if row in MIDDLE:
            return scan.n_rows // 2
        if not isinstance(row, int) or not 0 <= row < scan.n_rows:
            found = f"{row!r}; a row between 0 and {scan.n_rows - 1}, or mid, is needed."
            raise PipelineError(f"{self.function}.ind", found)
        return row


def frames(source: ProjectionSource | None, shape: tuple[int, ...], rows: Integers) -> Pixels:
    """(f, r, column) flats or darks of the chosen `rows`; one of zeros where there are none."""
    if source is None:
        return np.zeros((1, *shape[1:]), np.float32)
    return source.read(np.arange(source.shape[0]), rows)


@cache
def stage_of(module_path: str, function: str) -> type[Stage]:
    """Make the stage of an allowed function; its fields are what a user may set.

    Raises
    ------
    BackendMissingError
        If tomopy is not installed.
    """
    how = tomopy_adapter.allowed(module_path, function, function)
    keywords = tomopy_adapter.keywords(module_path, function)
    said: dict[str, Any] = {
        "__doc__": f"Call {module_path}.{function}.",
        "__module__": __name__,
        "__annotations__": {name: kind_of(keyword) for name, keyword in keywords.items()},
        "module_path": module_path,
        "function": function,
        "gives": (how.finds,) if how.finds else (),
        **{name: default_of(k) for name, k in keywords.items() if k.default is not Parameter.empty},
    }
    if function in TAKES:
        said["takes"] = TAKES[function]
    if function in LEAVES:
        said["leaves"] = (LEAVES[function],)
    return method(type(function, (TomopyFunction,), said))


def kind_of(keyword: Parameter) -> Any:
    """Return the type that values of a parameter must have, as its default shows it."""
    default = keyword.default
    if isinstance(default, bool | str):
        return type(default)
    if isinstance(default, int | float) and keyword.name != "axis":
        return int | float
    return Any


def default_of(keyword: Parameter) -> Any:
    """Return the default as a dataclass takes it."""
    default = keyword.default
    return field(default_factory=lambda: list(default)) if isinstance(default, list) else default


@dataclass(frozen=True)
class Functions(Mapping[str, type[Any]]):
    """The allowed functions of a module as stages; these are made, by tomopy, when asked for."""

    module_path: str

    def __getitem__(self, function: str) -> type[Any]:
        if function not in self:
            raise KeyError(function)
        return stage_of(self.module_path, function)

    def __contains__(self, function: object) -> bool:
        # The mapping's own would make the stage, which needs tomopy.
        return function in tomopy_adapter.ALLOWED[self.module_path]

    def __iter__(self) -> Iterator[str]:
        return iter(tomopy_adapter.ALLOWED[self.module_path])

    def __len__(self) -> int:
        return len(tomopy_adapter.ALLOWED[self.module_path])
