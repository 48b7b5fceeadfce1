"""The scan that is studied, and what several studies ask of it, found once."""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from tomoslam_stage.heldout import Rows, hold_out
from tomoslam_stage.pipeline import load_pipeline, run
from tomoslam_stage.products import Floats, Scan, Truth
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.scans import binned, open_scan, read_truth, write_simulated
from tomoslam_stage.simulation import recipe_from, simulate
from tomoslam_stage.stages import MODULES, Work
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import made

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)

Found = TypeVar("Found")

PUBLISHED: Mapping[str, Any] = {
    "phantom": "card",
    "n_projections": 360,
    "span_deg": 360.0,
    "angle_errors": [{"method": "walk", "sigma_deg": 0.05}],
    "rows": 256,
    "columns": 320,
    "seed": 0,
}
"""The scan of the paper's section 5, simulated; its detector is smaller, so that studies take
minutes."""
FAST: Mapping[str, Any] = {"n_projections": 120, "rows": 96, "columns": 128}
"""What is different where a study shall take seconds."""
AXIS_ROWS = 5


@dataclass(frozen=True)
class Case:
    """A scan, whether simulated or not."""

    path: Path
    """The scan."""
    folder: Path
    """Where pipelines that are run on it leave their reports."""
    origin: str
    """Where it comes from: a sentence for people."""
    known: dict[Hashable, Any] = field(default_factory=dict, repr=False, compare=False)
    """What was found already, see `once`."""

    @cached_property
    def scan(self) -> Scan:
        """The scan as the default pipeline works on it: binned where it is wide."""
        whole = open_scan(self.path)
        return binned(whole, -(-whole.n_columns // RefineTheta().width))

    @cached_property
    def truth(self) -> Truth | None:
        """What is known about a simulated scan."""
        return read_truth(self.path)

    @cached_property
    def rows(self) -> Rows:
        """Which rows the default pipeline takes keypoints from."""
        return hold_out(self.scan)

    @cached_property
    def axis(self) -> float:
        """Column of the axis, px of `scan`; the paper takes it for known, and so it is here."""
        if self.truth is not None and self.truth.axis is not None:
            return self.scan.column_from_file(self.truth.axis)
        some = self.rows.heldout[:: -(-len(self.rows.heldout) // AXIS_ROWS)]
        return Reprojection().find_axis(self.scan.sinograms(some), self.scan.theta)

    @property
    def reference(self) -> Floats:
        """(n,) radians: the angles that measured ones are held against."""
        return self.scan.theta if self.truth is None else self.truth.theta

    @property
    def reference_name(self) -> str:
        """What the angles of `reference` are."""
        return "recorded" if self.truth is None else "true"

    @cached_property
    def step_sigma_deg(self) -> float:
        """Standard deviation of the errors of the recorded steps, degrees; nan without truth."""
        if self.truth is None:
            return float("nan")
        return float(np.rad2deg(np.std(np.diff(self.scan.theta - self.truth.theta))))

    def refined(self, pipeline: str) -> Work:
        """Run a pipeline that comes with the package, its report in a folder of its own."""

        def work() -> Work:
            log.info("%s: running the pipeline %s", self.path.name, pipeline)
            folder = self.folder / f"pipeline_{pipeline}"
            done = Work(self.path, folder, dry_run=True)
            run(load_pipeline(pipeline), done, MODULES)
            return done

        return self.once(("pipeline", pipeline), work)

    def errors_of(self, pipeline: str) -> Mapping[str, float]:
        """Errors of the angles that a pipeline finds, see `comparison.metrics.errors_against`."""
        return made(self.refined(pipeline).comparison, "comparison").errors

    def once(self, key: Hashable, find: Callable[[], Found]) -> Found:
        """Return what `find` returns, and remember it under `key` for the next study."""
        if key not in self.known:
            self.known[key] = find()
        return cast(Found, self.known[key])


def simulated(folder: Path, changes: Mapping[str, Any]) -> Case:
    """Simulate the paper's case, with `changes` of the recipe, as a scan in `folder`.

    Raises
    ------
    PipelineError
        If the recipe has no such key, or a value does not fit.
    """
    scan = simulate(recipe_from({**PUBLISHED, **changes}, "case"))
    path = folder / "case.h5"
    write_simulated(path, scan)
    return Case(path, folder, _said(scan.recipe.described()))


def given(path: Path, folder: Path) -> Case:
    """Study the scan at `path`."""
    n, rows, columns = open_scan(path).source.shape
    truth = "with its true angles" if read_truth(path) else "whose true angles nobody knows"
    size = f"{n} projections of {rows} x {columns} px"
    return Case(path, folder, f"Scan {path.name}, {truth}: {size}.")


def _said(recipe: Mapping[str, Any]) -> str:
    errors = [
        " ".join([error["method"], *(f"{v:g} deg" for k, v in error.items() if k.endswith("_deg"))])
        for error in recipe["angle_errors"]
    ]
    return (
        f"Simulated, as no scan was given: {recipe['phantom']['method']}, "
        f"{recipe['n_projections']} projections of {recipe['rows']} x {recipe['columns']} px over "
        f"{recipe['span_deg']:g} degrees, stage error {' and '.join(errors) or 'none'}, "
        f"seed {recipe['seed']}."
    )
