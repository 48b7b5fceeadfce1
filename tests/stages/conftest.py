"""Small scans of grains with a lost step, and what refining one of them found."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tomoslam_stage.products import Pixels, Refinement
from tomoslam_stage.scans import write_simulated
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate
from tomoslam_stage.stages import STAGES, Work, refine_theta

FlatFielded = Callable[[SimulatedScan], Pixels]

LOST = {
    "phantom": {"method": "grains", "grains": 300, "seed": 5},
    "angle_errors": [{"method": "lost_step", "size_deg": 2.5, "projection": 45}],
    "n_projections": 90,
    "rows": 96,
    "columns": 128,
    "axis_offset": 2.0,
    "seed": 5,
}
SMOOTH = LOST | {"phantom": {"method": "smooth", "seed": 5}, "n_projections": 60}
SMOOTH |= {"angle_errors": [{"method": "walk", "sigma_deg": 0.2}]}


@pytest.fixture(scope="session")
def grains() -> SimulatedScan:
    """A scan whose features show that the stage lost a step of 2.5 degrees."""
    return simulate(recipe_from(LOST))


@pytest.fixture(scope="session")
def integrals(grains: SimulatedScan, flat_fielded: FlatFielded) -> Pixels:
    """(n, row, column) line integrals of `grains`."""
    return flat_fielded(grains)


@pytest.fixture(scope="session")
def refined(grains: SimulatedScan, integrals: np.ndarray) -> Refinement:
    """What `refine_theta` says about `grains`."""
    return refine_theta(integrals, grains.theta_recorded)


def written(path: Path, made: SimulatedScan) -> Path:
    write_simulated(path, made)
    return path


def ran(work: Work, *stages: str, **parameters: object) -> Work:
    """Run stages by name, with `parameters` for the last one."""
    for name in stages:
        STAGES[name](**parameters if name == stages[-1] else {}).run(work)
    return work


@pytest.fixture(scope="session")
def run() -> Callable[..., Work]:
    """See `ran`."""
    return ran


@pytest.fixture(scope="session")
def written_to() -> Callable[[Path, SimulatedScan], Path]:
    """See `written`."""
    return written


@pytest.fixture(scope="session")
def grains_file(tmp_path_factory: pytest.TempPathFactory, grains: SimulatedScan) -> Path:
    """The scan of `grains` in a file; nobody writes to it."""
    return written(tmp_path_factory.mktemp("grains") / "grains.h5", grains)


@pytest.fixture(scope="session")
def done(grains_file: Path) -> Work:
    """A run on `grains_file` as far as `refine_theta`, which accepts."""
    work = Work(path=grains_file, folder=grains_file.parent / "report")
    return ran(work, "load_scan", "refine_theta")


@pytest.fixture
def accepted(tmp_path: Path, done: Work) -> Work:
    """The same run on a scan of one's own."""
    path = Path(shutil.copy(done.path, tmp_path / "scan.h5"))
    return replace(done, path=path, folder=tmp_path / "report")


@pytest.fixture(scope="session")
def smooth_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan in which there is nothing to track."""
    return written(tmp_path_factory.mktemp("smooth") / "smooth.h5", simulate(recipe_from(SMOOTH)))
