"""What was done to a scan, kept in the scan: the actor group and the table of processes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from h5py import File, Group

    from tomoslam_stage.products import Floats
    from tomoslam_stage.scans.contents import Places

COLUMNS = ("actor", "start_time", "end_time", "status", "message", "reference", "description")
DESCRIPTION = "rotation angle refinement"


def now() -> str:
    """Return the time as DXchange writes it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@dataclass(frozen=True)
class ProcessRecord:
    """One run, as the scan remembers it."""

    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Everything the run was told: plain values, lists and mappings of them."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Version by name of the package."""
    started: str = field(default_factory=now)
    """ISO 8601."""
    ended: str = field(default_factory=now)
    """ISO 8601."""
    message: str = "theta refined"
    """One line for the table."""
    shift_px: Floats | None = None
    """(n,) px of the detector that each projection lies to the right, where some were found to."""
    shift_sigma_px: Floats | None = None
    """(n,) px of the detector: one standard deviation of `shift_px`."""


def write_actor(file: File, actor: str, record: ProcessRecord) -> None:
    """Write parameters and versions, as JSON for programs and one by one for readers; shifts."""
    group = file.require_group(actor)
    shifts = {"shift_px": record.shift_px, "shift_sigma_px": record.shift_sigma_px}
    for name in ("parameters", "versions", "settings", *shifts):
        if name in group:
            del group[name]
    group["parameters"] = json.dumps(record.parameters, default=str, sort_keys=True)
    group["versions"] = json.dumps(record.versions, sort_keys=True)
    settings = group.create_group("settings")
    for name, value in _leaves(record.parameters):
        settings[name] = value
    for name, values in shifts.items():
        if values is not None:
            group[name] = values
            group[name].attrs["units"] = "pixel"
    group.attrs["start_time"], group.attrs["end_time"] = record.started, record.ended


def _leaves(parameters: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield a dotted name and a value that HDF5 can hold for every leaf."""
    for key, value in parameters.items():
        name = f"{prefix}{key}".replace("/", "_")
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{name}.")
        elif isinstance(value, bool | int | float | str):
            yield name, value
        else:
            yield name, json.dumps(value, default=str)


def append_row(file: File, places: Places, record: ProcessRecord) -> None:
    """Append one SUCCESS row to the table; to one of ours if the file's has another shape."""
    row = {
        "actor": places.actor.rsplit("/", 1)[-1],
        "start_time": record.started,
        "end_time": record.ended,
        "status": "SUCCESS",
        "message": record.message,
        "reference": places.actor,
        "description": DESCRIPTION,
    }
    table = _table(file, places)
    for column, value in row.items():
        growing = table[column]
        growing.resize(growing.shape[0] + 1, axis=0)
        growing[-1] = value


def _table(file: File, places: Places) -> Group:
    """Return a table that a row fits into, making one where there is none."""
    own = f"{places.actor}/table"
    for place in (places.table, own):
        if place not in file:
            return _new_table(file, place)
        if _grows(file[place]):
            return file[place]
    del file[own]
    return _new_table(file, own)


def _new_table(file: File, place: str) -> Group:
    import h5py

    table = file.create_group(place)
    for column in COLUMNS:
        kind = h5py.string_dtype()
        table.create_dataset(column, shape=(0,), maxshape=(None,), chunks=(64,), dtype=kind)
    return table


def _grows(table: Any) -> bool:
    """Whether the table is a group of equally long columns of strings, each free to grow."""
    import h5py

    if not isinstance(table, h5py.Group):
        return False
    columns = [table.get(name) for name in COLUMNS]
    return all(_growing_strings(column) for column in columns) and (
        len({len(column) for column in columns}) == 1
    )


def _growing_strings(column: Any) -> bool:
    import h5py

    if not isinstance(column, h5py.Dataset) or column.maxshape != (None,):
        return False
    kind = h5py.check_string_dtype(column.dtype)
    return kind is not None and kind.length is None
