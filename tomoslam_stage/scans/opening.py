"""Opening a scan: everything is checked before the first projection is read."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Raw, Scan, Truth
from tomoslam_stage.scans.checks import check, frames_in, problems, recorded_angles
from tomoslam_stage.scans.dxchange import (
    DARKS,
    DATA,
    FLATS,
    RECORDED,
    TRUE_AXIS,
    TRUE_THETA,
    Contents,
    DatasetFacts,
    open_file,
    read_contents,
)
from tomoslam_stage.scans.kind import choose_conversion
from tomoslam_stage.scans.sources import ArraySource, FileSource, binned
from tomoslam_stage.scans.strings import read_units
from tomoslam_stage.scans.theta import to_radians
from tomoslam_stage.scans.transaction import recover

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.products import ProjectionSource
    from tomoslam_stage.scans.kind import Kind
    from tomoslam_stage.scans.theta import Units

log = logging.getLogger("tomoslam_stage")


def open_scan(
    path: Path,
    *,
    kind: Kind = "auto",
    units: Units = "auto",
    parallel: bool = False,
    binning: int = 1,
) -> Scan:
    """Open a DXchange scan; its projections are read when they are asked for.

    Where an earlier run wrote refined angles, the recorded ones are taken again.

    Parameters
    ----------
    path
        The file; it is only ever read.
    kind
        What ``/exchange/data`` holds; ``auto`` decides by what is there.
    units
        Of theta; ``auto`` believes the file, and guesses with a warning where it is silent.
    parallel
        Take the beam for parallel, whatever distances the file holds.
    binning
        Detector pixels averaged along rows and along columns.

    Raises
    ------
    ScanError
        If the scan cannot be used; the message says what was found and what is needed.
    """
    return binned(_opened(Path(path), kind, units, parallel)[0], binning)


def open_as_stored(path: Path) -> Scan:
    """Open a scan as `open_scan`, but leave its values as the detector stored them.

    What it takes to make line integrals of them is in `Scan.raw`.
    """
    return _as_stored(*_opened(Path(path), "auto", "auto", False))


def _opened(path: Path, kind: Kind, units: Units, parallel: bool) -> tuple[Scan, Contents]:
    recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        check(contents, parallel=parallel)
        theta = recorded_angles(contents, units)
        conversion = choose_conversion(contents, file, kind)
    n, rows, columns = contents.datasets[DATA].shape
    _log_angles(contents, np.degrees(theta))
    source = FileSource(path, (n, rows, columns), conversion)
    return Scan(source, theta, np.arange(n), name=path.name, path=path), contents


def _as_stored(scan: Scan, contents: Contents) -> Scan:
    source = scan.source
    if not isinstance(source, FileSource) or source.conversion is None:
        return scan
    if source.conversion.kind == "line_integrals":
        return scan
    flats = _frames(source.path, FLATS, contents.flats)
    darks = _frames(source.path, DARKS, contents.darks)
    raw = Raw(source.conversion, flats, darks)
    return replace(scan, source=replace(source, conversion=None), raw=raw)


def _frames(path: Path, key: str, facts: DatasetFacts | None) -> ProjectionSource | None:
    if facts is None:
        return None
    if len(facts.shape) == 3:
        frames, rows, columns = facts.shape
        return FileSource(path, (frames, rows, columns), None, key)
    with open_file(path) as file:
        return ArraySource(file[key][()][None])


def _log_angles(contents: Contents, degrees: Any) -> None:
    if contents.refined:
        log.info("%s: starting again from %s", contents.path.name, RECORDED)
    log.info(
        "%s: %d projections over %.6g degrees, median step %.4g degrees",
        contents.path.name,
        len(degrees),
        np.ptp(degrees),
        np.median(np.diff(degrees)),
    )


def describe_scan(path: Path) -> dict[str, Any]:
    """Collect the facts of a scan for ``inspect``: plain values, ready for JSON.

    Nothing is refused but a file that is not HDF5: what is wrong is listed under ``problems``.
    """
    path = Path(path)
    recovered = recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        wrong = list(problems(contents))
        facts: dict[str, Any] = {"file": path.name, "layout": "DXchange", "recovered": recovered}
        facts |= _detector_facts(contents)
        if not wrong:
            facts |= _checked_facts(contents, file, wrong)
        return facts | {"simulated": TRUE_THETA in file, "problems": wrong}


def _detector_facts(contents: Contents) -> dict[str, Any]:
    data = contents.datasets.get(DATA)
    return {
        "shape": None if data is None else list(data.shape),
        "dtype": None if data is None else str(data.dtype),
        "chunks": None if data is None or data.chunks is None else list(data.chunks),
        "flats": frames_in(contents.flats),
        "darks": frames_in(contents.darks),
        "flat_groups": len(set(contents.flat_positions)) if contents.flats else 0,
        "theta_units": contents.units,
        "refined": contents.refined,
        "magnification": contents.beam.magnification,
    }


def _checked_facts(contents: Contents, file: File, wrong: list[str]) -> dict[str, Any]:
    """Add what only a sound scan can tell; what goes wrong on the way is added to `wrong`."""
    try:
        degrees = np.degrees(recorded_angles(contents, "auto"))
        kind = choose_conversion(contents, file, "auto").kind
    except ScanError as error:
        wrong.append(str(error))
        return {}
    steps = np.diff(degrees)
    return {
        "kind": kind,
        "first_deg": float(degrees[0]),
        "last_deg": float(degrees[-1]),
        "span_deg": float(np.ptp(degrees)),
        "median_step_deg": float(np.median(steps)),
        "step_range_deg": [float(steps.min()), float(steps.max())],
    }


def read_truth(path: Path) -> Truth | None:
    """Read the true angles of a simulated scan; None for a real one. For the report alone."""
    with open_file(Path(path)) as file:
        if TRUE_THETA not in file:
            return None
        stored = file[TRUE_THETA]
        unit = "rad" if (read_units(stored) or "deg").lower().startswith("rad") else "deg"
        axis = float(file[TRUE_AXIS][()]) if TRUE_AXIS in file else None
        return Truth(to_radians(np.asarray(stored[()], np.float64), unit), axis)
