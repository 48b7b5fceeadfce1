"""What a DXchange file holds: its datasets, angles and order of frames, as plain facts.

Nothing here reads a pixel. A file is open only while it is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tomoslam_stage.scans.beam import read_beam
from tomoslam_stage.scans.contents import Contents, Places, References, look_at
from tomoslam_stage.scans.labels import LOCATION, Labels, read_labels
from tomoslam_stage.scans.strings import read_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from h5py import File

    from tomoslam_stage.scans.datasets import DatasetFacts

DATA = "/exchange/data"
FLATS = "/exchange/data_white"
DARKS = "/exchange/data_dark"
THETA = "/exchange/theta"
RECORDED = "/exchange/theta_recorded"
SIGMA = "/exchange/theta_sigma"
ACTOR = "/process/tomoslam_stage"
TABLE = "/process/table"
TRUE_THETA = "/simulation/theta_true"
TRUE_AXIS = "/simulation/axis_px"
TRUE_SHIFT = "/simulation/shift_px"
FRAME_LOCATION = LOCATION
GEOMETRY = ("measurement", "process/acquisition", "exchange/geometry")
"""Groups where distances are kept."""
FLAT_MODE = "/process/acquisition/flat_fields/flat_field_mode"


PLACES = Places(DATA, THETA, RECORDED, SIGMA, ACTOR, TABLE, FLATS, DARKS)
LINKED = (DATA, FLATS, DARKS, "/measurement", "/defaults", "/process/acquisition")
"""What a companion links to."""


@dataclass(frozen=True)
class DxChange:
    """The layout of the APS: projections, flats and darks in datasets of their own."""

    name: ClassVar[str] = "DXchange"
    mixed: ClassVar[bool] = False

    @property
    def places(self) -> Places:
        """Always the same."""
        return PLACES

    def read(self, file: File, path: Path) -> Contents:
        """Look at everything but the pixels."""
        found = look_at(file, path, self, (FLATS, DARKS))
        return replace(
            found,
            flats=_references(FLATS, found.datasets),
            darks=_references(DARKS, found.datasets),
            flat_positions=_flat_positions(file, found.datasets),
            beam=read_beam(file, GEOMETRY),
            labels=_labels(file, found.datasets),
        )

    def aliases(self, file: File, place: str) -> list[str]:  # noqa: ARG002
        """None: everybody reads datasets where they are."""
        return []

    def declare(self, file: File, version: str) -> None:
        """Nothing more: the table of processes says it all."""

    def link(self, companion: File, scan: File, scan_seen: str) -> None:
        """Copy the recorded angles and link to the rest."""
        import h5py

        companion["implements"] = "exchange:process"
        source = RECORDED if PLACES.is_ours(scan) else THETA
        scan.copy(scan[source], companion.require_group("/exchange"), name="theta_recorded")
        for place in LINKED:
            if place in scan:
                companion[place] = h5py.ExternalLink(scan_seen, place)


def _references(key: str, datasets: Mapping[str, DatasetFacts]) -> References | None:
    facts = datasets.get(key)
    here = facts is not None and facts.shape and facts.shape[0] > 0
    return References(key, facts.shape) if facts is not None and here else None


def _labels(file: File, datasets: Mapping[str, DatasetFacts]) -> Labels:
    facts = datasets.get(DATA)
    if facts is None or not facts.shape:
        return Labels()
    return read_labels(file, facts.shape[0], _located(file), DATA)


def _flat_positions(file: File, datasets: Mapping[str, DatasetFacts]) -> tuple[float, ...]:
    """Say how many projections preceded each flat; all zeros where the file does not tell."""
    import h5py

    if any(key not in datasets or len(datasets[key].shape) != 3 for key in (FLATS, DATA)):
        return (0,)
    count, projections = datasets[FLATS].shape[0], datasets[DATA].shape[0]
    located = _located(file)
    if located.count(FLATS) == count and located.count(DATA) == projections:
        before = np.cumsum([place == DATA for place in located])
        return tuple(int(before[i]) for i, place in enumerate(located) if place == FLATS)
    mode = file.get(FLAT_MODE)
    if isinstance(mode, h5py.Dataset) and read_text(mode[()]).lower() == "both":
        return (0,) * (count // 2) + (projections,) * (count - count // 2)
    return (0,) * count


def _located(file: File) -> list[str]:
    """Return the dataset every frame went to, in order of acquisition."""
    import h5py

    places = file.get(FRAME_LOCATION)
    if not isinstance(places, h5py.Dataset) or places.ndim != 1:
        return []
    return [read_text(place) for place in places[()]]
