"""Opening a scan: everything is checked before the first projection is read."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict, Unpack

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Raw, Scan, Truth
from tomoslam_stage.scans.checks import check, problems, recorded_angles
from tomoslam_stage.scans.dxchange import TRUE_AXIS, TRUE_SHIFT, TRUE_THETA
from tomoslam_stage.scans.files import open_file
from tomoslam_stage.scans.kind import choose_conversion
from tomoslam_stage.scans.layouts import read_contents
from tomoslam_stage.scans.pairing import Choice
from tomoslam_stage.scans.projections import Projections, projections
from tomoslam_stage.scans.sources import (
    ArraySource,
    ChosenSource,
    ConvertedSource,
    FileSource,
    binned,
)
from tomoslam_stage.scans.strings import read_units
from tomoslam_stage.scans.theta import to_radians
from tomoslam_stage.scans.transaction import recover

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.products import Conversion, Integers, ProjectionSource
    from tomoslam_stage.scans.contents import Contents, References
    from tomoslam_stage.scans.kind import Kind
    from tomoslam_stage.scans.theta import Units

log = logging.getLogger("tomoslam_stage")


class Asked(TypedDict, total=False):
    """What may be asked for when a scan is opened; each has a default."""

    kind: Kind
    """What the data hold; ``auto`` decides by what is there."""
    units: Units
    """Of theta; ``auto`` believes the file, and guesses with a warning where it is silent."""
    parallel: bool
    """Take the beam for parallel, whatever distances the file holds."""
    binning: int
    """Detector pixels averaged along rows and along columns."""
    frames: Choice
    """Which frames are used, and which angles have none."""


def open_scan(path: Path, **asked: Unpack[Asked]) -> Scan:
    """Open a DXchange or NXtomo scan; its projections are read when they are asked for.

    Where an earlier run wrote refined angles, the recorded ones are taken again.

    Parameters
    ----------
    path
        The file; it is only ever read.
    asked
        See `Asked`.

    Raises
    ------
    ScanError
        If the scan cannot be used; the message says what was found and what is needed.
    """
    opened = _opened(Path(path), asked)
    return binned(_only(opened.scan, opened.used), asked.get("binning", 1))


def open_as_stored(path: Path) -> Scan:
    """Open a scan as `open_scan`, but leave its values as the detector stored them.

    What it takes to make line integrals of them is in `Scan.raw`.
    """
    opened = _opened(Path(path), {})
    return _only(_as_stored(opened.scan, opened.contents), opened.used)


class _Opened(NamedTuple):
    """A file that passed all checks."""

    scan: Scan
    """All of its frames."""
    contents: Contents
    used: Projections
    """Which of the frames are used."""


def _opened(path: Path, asked: Asked) -> _Opened:
    recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        check(contents, parallel=asked.get("parallel", False))
        theta = recorded_angles(contents, asked.get("units", "auto"))
        conversion = choose_conversion(contents, file, asked.get("kind", "auto"))
    source = _source(contents, conversion)
    n = source.shape[0]
    frames = ConvertedSource(replace(source, conversion=None), conversion)
    used = projections(contents, theta, frames, asked.get("frames", Choice()))
    scan = Scan(source, used.theta_of_frames, np.arange(n), name=path.name, path=path)
    _log_angles(contents, np.degrees(used.theta_of_frames[used.frames]))
    return _Opened(scan, contents, used)


def _source(contents: Contents, conversion: Conversion | None) -> FileSource:
    """All frames of the data, as line integrals or as they are stored."""
    n, rows, columns = contents.data.shape
    return FileSource(contents.path, (n, rows, columns), conversion, contents.places.data)


def _only(scan: Scan, used: Projections) -> Scan:
    """Return `scan` with the frames that are used."""
    if len(used.frames) == scan.n_projections:
        return scan
    return replace(
        scan,
        source=ChosenSource(scan.source, used.frames),
        theta=used.theta_of_frames[used.frames],
        frames=used.frames,
        theta_of_frames=used.theta_of_frames,
        left_out=used.left_out,
    )


def _as_stored(scan: Scan, contents: Contents) -> Scan:
    source = scan.source
    if not isinstance(source, FileSource) or source.conversion is None:
        return scan
    if source.conversion.kind == "line_integrals":
        return scan
    flats = _frames(source.path, contents.flats)
    darks = _frames(source.path, contents.darks)
    raw = Raw(source.conversion, flats, darks)
    return replace(scan, source=replace(source, conversion=None), raw=raw)


def _frames(path: Path, some: References | None) -> ProjectionSource | None:
    if some is None:
        return None
    if len(some.shape) == 3:
        frames, rows, columns = some.shape
        whole = FileSource(path, (frames, rows, columns), None, some.place)
        return whole if some.frames is None else ChosenSource(whole, some.frames)
    with open_file(path) as file:
        return ArraySource(file[some.place][()][None])


def _log_angles(contents: Contents, degrees: Any) -> None:
    if contents.refined:
        log.info("%s: starting again from %s", contents.path.name, contents.angles_from)
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
        facts: dict[str, Any] = {
            "file": path.name,
            "layout": contents.layout.name,
            "recovered": recovered,
        }
        facts |= _detector_facts(contents)
        if not wrong:
            facts |= _checked_facts(contents, file, wrong)
        return facts | {"simulated": TRUE_THETA in file, "problems": wrong}


def _detector_facts(contents: Contents) -> dict[str, Any]:
    data = contents.datasets.get(contents.places.data)
    return {
        "shape": None if data is None else list(data.shape),
        "dtype": None if data is None else str(data.dtype),
        "chunks": None if data is None or data.chunks is None else list(data.chunks),
        "flats": contents.flats.n_frames if contents.flats else 0,
        "darks": contents.darks.n_frames if contents.darks else 0,
        "flat_groups": len(set(contents.flat_positions)) if contents.flats else 0,
        "theta_units": contents.units,
        "refined": contents.refined,
        "magnification": contents.beam.magnification,
    }


def _checked_facts(contents: Contents, file: File, wrong: list[str]) -> dict[str, Any]:
    """Add what only a sound scan can tell; what goes wrong on the way is added to `wrong`."""
    try:
        theta = recorded_angles(contents, "auto")
        conversion = choose_conversion(contents, file, "auto")
        stored = _source(contents, None)
        used = projections(contents, theta, ConvertedSource(stored, conversion), Choice())
    except ScanError as error:
        wrong.append(str(error))
        return {}
    degrees = np.degrees(used.theta_of_frames[used.frames])
    steps = np.diff(degrees)
    return {
        "kind": conversion.kind,
        "projections": len(used.frames),
        "frames_left_out": [f"{frame}: {why}" for frame, why in used.left_out.items()],
        "first_deg": float(degrees[0]),
        "last_deg": float(degrees[-1]),
        "span_deg": float(np.ptp(degrees)),
        "median_step_deg": float(np.median(steps)),
        "step_range_deg": [float(steps.min()), float(steps.max())],
    }


def read_truth(path: Path, frames: Integers | None = None) -> Truth | None:
    """Read the true angles of a simulated scan; None for a real one. For the report alone.

    Of some `frames` (n,) only, where these are given.
    """
    import h5py

    path = Path(path)
    with open_file(path) as file:
        if TRUE_THETA not in file:
            return None
        stored, axis = file[TRUE_THETA], file.get(TRUE_AXIS)
        n = read_contents(file, path).data.shape[0]
        if not _one_each(stored, n):
            log.warning("%s: %s is not one angle for each projection", path.name, TRUE_THETA)
            return None
        unit = "rad" if (read_units(stored) or "deg").lower().startswith("rad") else "deg"
        known = isinstance(axis, h5py.Dataset) and axis.shape == () and axis.dtype.kind in "iuf"
        theta = to_radians(np.asarray(stored[()], np.float64), unit)
        some = np.arange(n) if frames is None else frames
        shift = file.get(TRUE_SHIFT)
        return Truth(
            theta[some],
            float(axis[()]) if known else None,
            np.asarray(shift[()], np.float64)[some] if _one_each(shift, n) else None,
        )


def _one_each(stored: Any, n: int) -> bool:
    """Whether what is `stored` is a dataset of one number for each of `n` projections."""
    import h5py

    return isinstance(stored, h5py.Dataset) and stored.shape == (n,) and stored.dtype.kind in "iuf"
