"""What a scan's file holds, whatever its layout, as plain facts: no pixel has been read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np

from tomoslam_stage.scans.beam import Beam
from tomoslam_stage.scans.datasets import DatasetFacts, look
from tomoslam_stage.scans.labels import Labels
from tomoslam_stage.scans.strings import read_units

if TYPE_CHECKING:
    from pathlib import Path

    from h5py import File
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Integers

BESIDES = ("flat", "dark")
"""Kinds of frames that are no projections, and never were."""


@dataclass(frozen=True)
class Places:
    """Where a layout keeps what: paths in the file."""

    data: str
    theta: str
    recorded: str
    """The recorded angles, once refined ones have taken their place."""
    sigma: str
    actor: str
    """The group that remembers what was done."""
    table: str
    """The table of all processes."""
    flats: str = ""
    """Empty where flats lie among the projections."""
    darks: str = ""

    def is_ours(self, file: File) -> bool:
        """Whether the recorded angles were set aside by an earlier run of this program."""
        return self.recorded in file and self.actor in file


class References(NamedTuple):
    """Flats or darks."""

    place: str
    """The dataset."""
    shape: tuple[int, ...]
    """Of the dataset."""
    frames: Integers | None = None
    """(f,) which of its frames they are; None: all of them."""

    @property
    def n_frames(self) -> int:
        """How many; a single one may be stored without an axis of its own."""
        if self.frames is not None:
            return len(self.frames)
        return self.shape[0] if len(self.shape) == 3 else 1


@dataclass(frozen=True)
class Contents:
    """What was found in a file, right or wrong; `checks` says which."""

    path: Path
    layout: Layout
    datasets: Mapping[str, DatasetFacts] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)
    """Why a dataset cannot be used, by its path in the file."""
    angles: NDArray[Any] | None = None
    """The recorded angles as they are stored."""
    angles_from: str = ""
    """Where they are stored: `Places.recorded` once refined angles were written."""
    units: str | None = None
    """What the file says about the units of the angles."""
    flats: References | None = None
    """The flats, where there is at least one."""
    darks: References | None = None
    """The darks, where there is at least one."""
    flat_positions: tuple[float, ...] = ()
    """How many frames of the data were taken before each flat."""
    beam: Beam = field(default_factory=Beam)
    labels: Labels = field(default_factory=Labels)
    """What it says about single frames."""
    wrong: tuple[str, str] | None = None
    """What contradicts the layout, and what to do about it."""

    @property
    def places(self) -> Places:
        """Where the file keeps what."""
        return self.layout.places

    @property
    def data(self) -> DatasetFacts:
        """The projections, from the outside."""
        return self.datasets[self.places.data]

    @property
    def refined(self) -> bool:
        """Whether the file holds refined angles of an earlier run."""
        return self.angles_from == self.places.recorded

    @property
    def besides(self) -> Integers:
        """(k,) frames of the data that are flats or darks."""
        n = self.data.shape[0]
        kinds = self.labels.kinds if self.layout.mixed and len(self.labels.kinds) == n else ()
        return np.array([i for i, kind in enumerate(kinds) if kind in BESIDES], np.intp)

    @property
    def frames(self) -> Integers:
        """(m,) frames of the data that are none of these."""
        return np.setdiff1d(np.arange(self.data.shape[0]), self.besides)


def look_at(file: File, path: Path, layout: Layout, others: Sequence[str] = ()) -> Contents:
    """Look at projections, recorded angles and `others` that a layout keeps; it adds the rest."""
    places = layout.places
    angles_from = places.recorded if places.is_ours(file) else places.theta
    looked = {key: look(file, key) for key in (places.data, *others, places.theta, angles_from)}
    datasets = {key: found for key, found in looked.items() if isinstance(found, DatasetFacts)}
    facts = datasets.get(angles_from)
    theta = None if facts is None or facts.unreadable else file[angles_from]
    return Contents(
        path=path,
        layout=layout,
        datasets=datasets,
        absent={key: found for key, found in looked.items() if isinstance(found, str)},
        angles=None if theta is None else np.asarray(theta[()]),
        angles_from=angles_from,
        units=None if theta is None else read_units(theta),
    )


class Layout(Protocol):
    """How one kind of file keeps a scan; it knows its way about the file it was found in."""

    name: ClassVar[str]
    """What people call it."""
    mixed: ClassVar[bool]
    """Whether flats and darks lie among the projections."""

    @property
    def places(self) -> Places:
        """Where it keeps what."""
        ...

    def read(self, file: File, path: Path) -> Contents:
        """Look at everything but the pixels."""
        ...

    def aliases(self, file: File, place: str) -> list[str]:
        """Other names, for viewers to look under, of the very dataset at `place`."""
        ...

    def declare(self, file: File, version: str) -> None:
        """Say in the layout's own terms what was written, by which `version` of this program."""
        ...

    def link(self, companion: File, scan: File, scan_seen: str) -> None:
        """Give a companion the recorded angles of the scan, and links to what stays there.

        Parameters
        ----------
        companion, scan
            Open files.
        scan_seen
            The scan's path as seen from the companion.
        """
        ...


def in_degrees(recorded: NDArray[Any], refined_deg: Floats, frames: Integers) -> Floats:
    """Return recorded angles (n,) in degrees.

    Parameters
    ----------
    recorded
        (n,) as they are stored: degrees, or radians where as such they lie nearer.
    refined_deg
        (n,) degrees.
    frames
        Those that are projections.
    """
    stored = np.asarray(recorded, np.float64)

    def apart(degrees: Floats) -> float:
        return float(np.nansum(np.abs(without_turns(degrees - refined_deg)[frames])))

    return min(stored, np.degrees(stored), key=apart)


def without_turns(change_deg: Floats) -> Floats:
    """Return differences of angles, degrees, between half a turn back and half a turn on."""
    return (change_deg + 180) % 360 - 180


def way_to(place: str) -> list[str]:
    """List the groups on the way to `place`, and `place` itself."""
    parts = place.strip("/").split("/")
    return ["/" + "/".join(parts[: i + 1]) for i in range(len(parts))]
