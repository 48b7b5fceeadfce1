"""Writing refined angles: into the scan, or into a companion file beside it; and back."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import transaction
from tomoslam_stage.scans.contents import in_degrees, way_to, without_turns
from tomoslam_stage.scans.files import open_file
from tomoslam_stage.scans.fresh import check_new_file, fresh_file
from tomoslam_stage.scans.layouts import read_contents, recognised
from tomoslam_stage.scans.provenance import ProcessRecord, append_row, now, write_actor
from tomoslam_stage.scans.transaction import ELSEWHERE, edit, recover

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.products import Floats
    from tomoslam_stage.scans.contents import Contents, Places

COMPANION = "companion_of"
"""Root attribute of a companion file: the scan it belongs to."""
PLOT = "correction"
"""Group within the actor, which viewers of NeXus files plot."""


def write_theta(
    path: Path, refined: Floats, sigma: Floats, record: ProcessRecord, *, safe_copy: bool = False
) -> None:
    """Make `refined` the angles of the scan, in one transaction.

    The recorded angles are renamed (``/exchange/theta_recorded``, or ``rotation_angle_recorded``
    in an NXtomo entry), bytes and attributes as they are; a further run replaces the refined angles
    only, and appends a row to the table. Flats and darks of an NXtomo stack keep their angles.

    Parameters
    ----------
    path
        The scan.
    refined
        (n,) radians, one for each projection in the file (NXtomo: for each frame of the stack).
    sigma
        (n,) radians, one standard deviation; NaN where nothing was measured.
    record
        What the file is to remember of the run.
    safe_copy
        Edit a copy however large the scan is, see `transaction.edit`.

    Raises
    ------
    ScanError
        If the scan cannot be edited; it is then as it was.
    """
    path = Path(path)
    recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        places = contents.places
        _check_editable(file, places, path.name)
        written = _to_write(contents, refined, sigma)
        recorded = _stored(file, contents.angles_from)

    def change(file: File) -> None:
        aliases = contents.layout.aliases(file, places.theta)
        if not places.is_ours(file):
            file.move(places.theta, places.recorded)
        _write(file, contents, written, record)
        append_row(file, places, record)
        _point(file, aliases, places.theta)

    def verify(file: File) -> None:
        _check_same(file, places.theta, written.theta, path.name)
        _check_same(file, places.recorded, recorded, path.name)

    edit(path, change, verify, safe_copy=safe_copy)


def check_writable(path: Path, *, safe_copy: bool = False) -> None:
    """Find out before any work what would stop `write_theta` after it.

    Raises
    ------
    ScanError
        If something would.
    """
    path = Path(path)
    with open_file(path) as file:
        _check_editable(file, recognised(file, path).places, path.name)
    transaction.check_writable(path, safe_copy=safe_copy)


def is_written(path: Path, started: str) -> bool:
    """Whether a scan or a companion holds the angles of the run that `started` then (ISO 8601)."""
    try:
        with open_file(Path(path)) as file:
            places = recognised(file, Path(path)).places
            ours = places.is_ours(file)
            return ours and file[places.actor].attrs.get("start_time") == started
    except ScanError:
        return False


def revert(path: Path, *, safe_copy: bool = False) -> None:
    """Restore the recorded angles exactly, in one transaction.

    Raises
    ------
    ScanError
        If the scan holds no refined angles, or cannot be edited.
    """
    path = Path(path)
    recover(path)
    with open_file(path) as file:
        layout = recognised(file, path)
        places = layout.places
        if not places.is_ours(file):
            found = f"there is no {places.recorded} of an earlier run; nothing to revert."
            raise ScanError(path.name, found, "Its angles are the recorded ones.")
        _check_editable(file, places, path.name)
        recorded = _stored(file, places.recorded)

    def change(file: File) -> None:
        aliases = layout.aliases(file, places.theta)
        for name in (places.theta, places.sigma, f"{places.actor}/{PLOT}"):
            if name in file:
                del file[name]
        file.move(places.recorded, places.theta)
        append_row(file, places, ProcessRecord(message="recorded theta restored"))
        file[places.actor].attrs["reverted"] = now()
        _point(file, aliases, places.theta)

    def verify(file: File) -> None:
        _check_same(file, places.theta, recorded, path.name)

    edit(path, change, verify, safe_copy=safe_copy, way_out="Its angles stay the refined ones.")


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
        (n,) radians, as `write_theta` takes them.
    record
        What the file is to remember of the run.

    Raises
    ------
    ScanError
        If `output` is another file already, or cannot be written.
    """
    path, output = Path(path), Path(output)
    check_output(output, path)
    note = replace(record, parameters={**record.parameters, "scan": path.name})
    with open_file(path) as scan:
        contents = read_contents(scan, path)
        written = _to_write(contents, refined, sigma)
        with fresh_file(output.resolve()) as file:
            seen = os.path.relpath(path.resolve(), output.resolve().parent)
            file.attrs[COMPANION] = seen
            contents.layout.link(file, scan, seen)
            _write(file, contents, written, note)
            append_row(file, contents.places, note)


def check_output(output: Path, path: Path) -> None:
    """Check that the scan at `path` may have the companion `output`, and that it can be written.

    Raises
    ------
    ScanError
        If it is another file already, or has no folder that new files may be made in.
    """
    import h5py

    path, output = Path(path), Path(os.path.realpath(output))
    check_new_file(output)
    if not output.exists():
        return
    if output.samefile(path):
        found = "the output is the scan itself."
        raise ScanError(output.name, found, "Leave --output away to write into the scan.")
    if output.is_file() and h5py.is_hdf5(output):
        with open_file(output) as file:
            target = file.attrs.get(COMPANION)
            if isinstance(target, str) and (output.parent / target).resolve() == path.resolve():
                return
    found = f"it exists, and is not an earlier output for {path.name}."
    raise ScanError(output.name, found, "Give --output another name, or remove it.")


def _check_editable(file: File, places: Places, name: str) -> None:
    """Check that all that is edited lies in this very file, under names that are free."""
    import h5py

    edited = (places.theta, places.recorded, places.sigma, places.table, f"{places.actor}/table")
    for place in dict.fromkeys(step for each in edited for step in way_to(each)):
        link = file.get(place, getlink=True)
        if isinstance(link, h5py.ExternalLink) or _lies_elsewhere(file, place):
            found = f"{place} is a link into another file, which is not to be edited unasked."
            raise ScanError(name, found, ELSEWHERE)
    if places.theta not in file:
        raise ScanError(name, f"{places.theta} is missing.", "Nothing was written.")
    taken = [place for place in (places.recorded, places.sigma) if place in file]
    if taken and not places.is_ours(file):
        found = f"{taken[0]} is there, but was not made by an earlier run."
        raise ScanError(name, found, f"Rename it. {ELSEWHERE}")


def _lies_elsewhere(file: File, place: str) -> bool:
    """Whether links, soft ones or those of a group on the way, lead out of the file."""
    return place in file and Path(file[place].file.filename) != Path(file.filename)


class _Written(NamedTuple):
    """Angles as they are stored."""

    theta: Floats
    """(n,) degrees."""
    sigma: Floats
    """(n,) degrees."""


def _to_write(contents: Contents, refined: Floats, sigma: Floats) -> _Written:
    """Check the angles; those of flats and darks among them stay as they were recorded."""
    n, name = contents.data.shape[0], contents.path.name
    if refined.shape != (n,) or sigma.shape != (n,):
        raise ScanError(
            name,
            f"{refined.shape} refined angles and {sigma.shape} sigmas for {n} projections; "
            "one of each per projection is needed.",
        )
    if not np.isfinite(refined).all():
        bad = int((~np.isfinite(refined)).sum())
        raise ScanError(name, f"{bad} refined angles are not finite; nothing was written.")
    theta, spread = (np.degrees(np.asarray(each, np.float64)) for each in (refined, sigma))
    if contents.angles is not None and contents.angles.shape == (n,):
        recorded = in_degrees(contents.angles, theta, contents.frames)
        theta[contents.besides] = recorded[contents.besides]
    spread[contents.besides] = np.nan
    return _Written(theta, spread)


def _write(file: File, contents: Contents, written: _Written, record: ProcessRecord) -> None:
    """Write angles, and what is to be remembered of them."""
    places = contents.places
    for place, degrees in ((places.theta, written.theta), (places.sigma, written.sigma)):
        if place in file:
            del file[place]
        file[place] = degrees
        file[place].attrs["units"] = "deg"
    write_actor(file, places.actor, record)
    _write_plot(file, contents, written)
    contents.layout.declare(file, record.versions.get("tomoslam-stage") or "unknown")


def _write_plot(file: File, contents: Contents, written: _Written) -> None:
    """Write refined minus recorded as viewers of NeXus files (silx, h5web) plot it."""
    place, recorded = f"{contents.places.actor}/{PLOT}", contents.angles
    if place in file:
        del file[place]
    if recorded is None or recorded.shape != written.theta.shape:
        return  # angles without a frame, or the other way round: nothing to subtract
    frames, group = contents.frames, file.create_group(place)
    group["frame"] = frames
    change = written.theta - in_degrees(recorded, written.theta, frames)
    group[PLOT] = without_turns(change)[frames]
    group[f"{PLOT}_errors"] = written.sigma[frames]
    group["title"] = "refined minus recorded angle"
    group[PLOT].attrs["units"] = group[f"{PLOT}_errors"].attrs["units"] = "deg"
    group.attrs.update({"NX_class": "NXdata", "signal": PLOT, "axes": ["frame"]})
    file[contents.places.actor].attrs["default"] = PLOT


def _point(file: File, aliases: list[str], place: str) -> None:
    """Let other names of the angles mean what is at `place` now; links by name do already."""
    import h5py

    for alias in aliases:
        if isinstance(file.get(alias, getlink=True), h5py.HardLink):
            del file[alias]
            file[alias] = file[place]


def _stored(file: File, place: str) -> Any:
    """Return the values; None where they lie in other files, out of reach while editing."""
    dataset = file[place]
    return None if dataset.is_virtual or dataset.external else dataset[()]


def _check_same(file: File, place: str, expected: Any, name: str) -> None:
    if expected is None:
        return
    if not np.array_equal(file[place][()], expected, equal_nan=True):
        found = f"{place} does not read back as it was written; the scan was left as it was."
        raise ScanError(name, found, ELSEWHERE)
