"""Writing scans: the file a simulated experiment leaves."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Floats
from tomoslam_stage.progress import progress
from tomoslam_stage.scans.dxchange import (
    DARKS,
    DATA,
    FLATS,
    FRAME_LOCATION,
    THETA,
    TRUE_AXIS,
    TRUE_SHIFT,
    TRUE_THETA,
)
from tomoslam_stage.scans.fresh import fresh_file

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.simulation import SimulatedScan


@dataclass(frozen=True)
class ScanContent:
    """What goes into a new scan."""

    projections: Iterable[NDArray[np.uint16]]
    """One (rows, columns) frame of counts per angle, in order; a generator will do."""
    flats: NDArray[np.uint16]
    """(f, rows, columns)"""
    darks: NDArray[np.uint16]
    """(d, rows, columns)"""
    theta_deg: Floats
    """(n,) degrees, recorded."""
    true_theta_deg: Floats | None = None
    """(n,) degrees."""
    true_axis_px: float | None = None
    """Detector column."""
    true_shift_px: Floats | None = None
    """(n,) px to the right of each projection."""
    flats_after: int = 0
    """How many of the flats, the last ones, were taken after the projections."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """How the scan was made: plain values."""


def write_simulated(path: Path, made: SimulatedScan) -> None:
    """Write a simulated scan with the truth about it, see `create_scan`."""
    content = ScanContent(
        projections=progress(made.projections(), "simulating", made.shape[0]),
        flats=made.whites,
        darks=made.darks,
        theta_deg=np.degrees(made.theta_recorded),
        true_theta_deg=np.degrees(made.theta_true),
        true_axis_px=made.axis,
        true_shift_px=made.shift if made.recipe.shift_px else None,
        parameters=made.recipe.described(),
    )
    create_scan(path, content)


def create_scan(path: Path, content: ScanContent) -> None:
    """Write a DXchange scan; only one projection at a time is held in memory.

    Raises
    ------
    ScanError
        If there are not as many projections as angles, or the file cannot be written. What had
        the name `path` before is then still there.
    """
    with fresh_file(Path(path).resolve()) as file:
        file["implements"] = "exchange:measurement:process"
        _write_projections(file, content, Path(path).name)
        file[FLATS], file[DARKS] = content.flats, content.darks
        _write_degrees(file, THETA, content.theta_deg)
        _write_frame_order(file, content)
        _write_truth(file, content)


def _write_projections(file: File, content: ScanContent, name: str) -> None:
    detector, n = content.flats.shape[1:], len(content.theta_deg)
    data = file.create_dataset(
        DATA, (n, *detector), np.uint16, chunks=(1, *detector), compression="gzip", shuffle=True
    )
    count = 0
    for count, projection in enumerate(content.projections, start=1):
        if count <= n:
            data[count - 1] = projection
    if count != n:
        raise ScanError(name, f"{count} projections for {n} angles; one for each is needed.")


def _write_frame_order(file: File, content: ScanContent) -> None:
    """Say where every frame went in order of acquisition, as the beamlines' own files do."""
    before = len(content.flats) - content.flats_after
    places = [DARKS] * len(content.darks) + [FLATS] * before
    places += [DATA] * len(content.theta_deg) + [FLATS] * content.flats_after
    file[FRAME_LOCATION] = np.array(places, dtype="S")


def _write_truth(file: File, content: ScanContent) -> None:
    if content.true_theta_deg is not None:
        _write_degrees(file, TRUE_THETA, content.true_theta_deg)
    if content.true_axis_px is not None:
        file[TRUE_AXIS] = float(content.true_axis_px)
    if content.true_shift_px is not None:
        file[TRUE_SHIFT] = content.true_shift_px
    file["/simulation/parameters"] = json.dumps(dict(content.parameters), sort_keys=True)


def _write_degrees(file: File, place: str, degrees: Floats) -> None:
    file[place] = np.asarray(degrees, np.float64)
    file[place].attrs["units"] = "deg"
