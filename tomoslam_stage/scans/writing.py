"""Writing refined angles: into the scan, or into a companion file beside it; and back."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.dxchange import (
    ACTOR,
    DARKS,
    DATA,
    FLATS,
    RECORDED,
    SIGMA,
    THETA,
    is_ours,
    open_file,
)
from tomoslam_stage.scans.fresh import fresh_file
from tomoslam_stage.scans.provenance import ProcessRecord, append_row, now, write_actor
from tomoslam_stage.scans.transaction import edit, recover

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.products import Floats

COMPANION = "companion_of"
"""Root attribute of a companion file: the scan it belongs to."""
LINKED = (DATA, FLATS, DARKS, "/measurement", "/defaults", "/process/acquisition")


def write_theta(path: Path, refined: Floats, sigma: Floats, record: ProcessRecord) -> None:
    """Make `refined` the angles of the scan, in one transaction.

    The recorded angles are renamed to ``/exchange/theta_recorded``, bytes and attributes as they
    are; a further run replaces the refined angles only, and appends a row to the table.

    Parameters
    ----------
    path
        The scan.
    refined
        (n,) radians, one for each projection in the file.
    sigma
        (n,) radians, one standard deviation; NaN where nothing was measured.
    record
        What the file is to remember of the run.

    Raises
    ------
    ScanError
        If the scan cannot be edited; it is then as it was.
    """
    path = Path(path)
    recover(path)
    with open_file(path) as file:
        _check_editable(file, path.name)
        _check_angles(refined, sigma, file[DATA].shape[0], path.name)
        recorded = _stored(file, RECORDED if is_ours(file) else THETA)

    def change(file: File) -> None:
        if not is_ours(file):
            file.move(THETA, RECORDED)
        _write_angles(file, refined, sigma)
        write_actor(file, record)
        append_row(file, record)

    def verify(file: File) -> None:
        _check_same(file, THETA, np.degrees(refined), path.name)
        _check_same(file, RECORDED, recorded, path.name)

    edit(path, change, verify)


def revert(path: Path) -> None:
    """Restore the recorded angles exactly, in one transaction.

    Raises
    ------
    ScanError
        If the scan holds no refined angles, or cannot be edited.
    """
    path = Path(path)
    recover(path)
    with open_file(path) as file:
        if not is_ours(file):
            found = f"there is no {RECORDED} of an earlier run; nothing to revert."
            raise ScanError(path.name, found, "Its angles are the recorded ones.")
        _check_editable(file, path.name)
        recorded = _stored(file, RECORDED)

    def change(file: File) -> None:
        for name in (THETA, SIGMA):
            if name in file:
                del file[name]
        file.move(RECORDED, THETA)
        append_row(file, ProcessRecord(message="recorded theta restored"))
        file[ACTOR].attrs["reverted"] = now()

    edit(path, change, lambda file: _check_same(file, THETA, recorded, path.name))


def write_companion(
    output: Path, path: Path, refined: Floats, sigma: Floats, record: ProcessRecord
) -> None:
    """Write the refined angles to a small file of their own, linked to the scan's data.

    Parameters
    ----------
    output
        The companion; only an earlier companion of the same scan is replaced.
    path
        The scan; it is not touched.
    refined, sigma
        (n,) radians.
    record
        What the file is to remember of the run.

    Raises
    ------
    ScanError
        If `output` is another file already, or cannot be written.
    """
    path, output = Path(path), Path(output)
    _check_output(output, path)
    note = replace(record, parameters={**record.parameters, "scan": path.name})
    with open_file(path) as scan:
        _check_angles(refined, sigma, scan[DATA].shape[0], path.name)
        with fresh_file(output.resolve()) as file:
            _fill_companion(file, scan, os.path.relpath(path.resolve(), output.resolve().parent))
            _write_angles(file, refined, sigma)
            write_actor(file, note)
            append_row(file, note)


def _fill_companion(file: File, scan: File, scan_seen_from_it: str) -> None:
    """Write the recorded angles, and links to what stays in the scan."""
    import h5py

    file.attrs[COMPANION] = scan_seen_from_it
    file["implements"] = "exchange:process"
    source = RECORDED if is_ours(scan) else THETA
    scan.copy(scan[source], file.require_group("/exchange"), name="theta_recorded")
    for place in LINKED:
        if place in scan:
            file[place] = h5py.ExternalLink(scan_seen_from_it, place)


def _check_output(output: Path, path: Path) -> None:
    import h5py

    if not output.exists():
        return
    if output.samefile(path):
        found = "the output is the scan itself."
        raise ScanError(output.name, found, "Leave --output away to write into the scan.")
    if output.is_file() and h5py.is_hdf5(output):
        with open_file(output) as file:
            target = file.attrs.get(COMPANION)
            if target and (output.resolve().parent / target).resolve() == path.resolve():
                return
    found = f"it exists, and is not an earlier output for {path.name}."
    raise ScanError(output.name, found, "Give --output another name, or remove it.")


def _check_editable(file: File, name: str) -> None:
    """Check that theta lies in this very file, under names that are free."""
    import h5py

    for place in ("/exchange", THETA, "/process", ACTOR):
        link = file.get(place, getlink=True) if place in file else None
        outside = link is not None and Path(file[place].file.filename) != Path(file.filename)
        if outside or isinstance(link, h5py.ExternalLink):
            found = f"{place} is a link into another file, which is not to be edited unasked."
            raise ScanError(name, found, "Pass --output FILE.")
    if THETA not in file:
        raise ScanError(name, f"{THETA} is missing.", "Nothing was written.")
    taken = [place for place in (RECORDED, SIGMA) if place in file]
    if taken and not is_ours(file):
        found = f"{taken[0]} is there, but was not made by an earlier run."
        raise ScanError(name, found, "Rename it, or pass --output FILE.")


def _check_angles(refined: Floats, sigma: Floats, n: int, name: str) -> None:
    if refined.shape != (n,) or sigma.shape != (n,):
        raise ScanError(
            name,
            f"{refined.shape} refined angles and {sigma.shape} sigmas for {n} projections; "
            "one of each per projection is needed.",
        )
    if not np.isfinite(refined).all():
        bad = int((~np.isfinite(refined)).sum())
        raise ScanError(name, f"{bad} refined angles are not finite; nothing was written.")


def _write_angles(file: File, refined: Floats, sigma: Floats) -> None:
    for place, radians in ((THETA, refined), (SIGMA, sigma)):
        if place in file:
            del file[place]
        file[place] = np.degrees(np.asarray(radians, np.float64))
        file[place].attrs["units"] = "deg"


def _stored(file: File, place: str) -> Any:
    """Return the values; None where they lie in other files, out of reach while editing."""
    dataset = file[place]
    return None if dataset.is_virtual or dataset.external else dataset[()]


def _check_same(file: File, place: str, expected: Any, name: str) -> None:
    if expected is None:
        return
    if not np.array_equal(file[place][()], expected, equal_nan=True):
        found = f"{place} does not read back as it was written; the scan was left as it was."
        raise ScanError(name, found, "Pass --output FILE.")
