"""What a DXchange file holds: its datasets, angles and order of frames, as plain facts.

Nothing here reads a pixel. A file is open only while it is looked at.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.beam import Beam, read_beam
from tomoslam_stage.scans.strings import read_text, read_units

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from h5py import File

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
FRAME_LOCATION = "/defaults/HDF5FrameLocation"
FLAT_MODE = "/process/acquisition/flat_fields/flat_field_mode"


@dataclass(frozen=True)
class DatasetFacts:
    """A dataset from the outside."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    chunks: tuple[int, ...] | None
    missing_filters: tuple[str, ...] = ()
    """Compression filters it needs that are not installed."""
    missing_files: tuple[str, ...] = ()
    """Files a virtual or external dataset draws on that are not there."""


@dataclass(frozen=True)
class Contents:
    """What was found in a file, right or wrong; `checks` says which."""

    path: Path
    datasets: Mapping[str, DatasetFacts] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)
    """Why a dataset cannot be used, by its path in the file."""
    angles: NDArray[Any] | None = None
    """The recorded angles as they are stored."""
    angles_from: str = THETA
    """Where they are stored: `RECORDED` once refined angles were written."""
    units: str | None = None
    """What the file says about the units of the angles."""
    flat_positions: tuple[int, ...] = ()
    """How many projections were taken before each flat."""
    beam: Beam = field(default_factory=Beam)

    @property
    def refined(self) -> bool:
        """Whether the file holds refined angles of an earlier run."""
        return self.angles_from == RECORDED

    @property
    def flats(self) -> DatasetFacts | None:
        """The flats, where there is at least one."""
        return self._frames(FLATS)

    @property
    def darks(self) -> DatasetFacts | None:
        """The darks, where there is at least one."""
        return self._frames(DARKS)

    def _frames(self, key: str) -> DatasetFacts | None:
        facts = self.datasets.get(key)
        return facts if facts is not None and facts.shape and facts.shape[0] > 0 else None


@contextmanager
def open_file(path: Path) -> Iterator[File]:
    """Open `path` for reading; its modification time stays.

    Raises
    ------
    ScanError
        If it is missing, not HDF5, cut off, or held by a writer.
    """
    import h5py

    if not path.is_file():
        raise ScanError(path.name, "there is no such file.", f"Looked for {path}.")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ScanError(path.name, *_why_not_opened(path, str(error))) from error
    with file:
        yield file


def _why_not_opened(path: Path, said: str) -> tuple[str, str]:
    if not os.access(path, os.R_OK):
        return "it may not be read by this user.", "Ask for read permission."
    if "truncated" in said:
        return "it is cut off: shorter than its own header says.", "Copy it again from its source."
    if "lock" in said:
        return "another program has it open for writing.", "Wait until that program is done."
    if "signature" in said:
        return "it is not an HDF5 file; DXchange in HDF5 is needed.", ""
    return f"it cannot be opened as HDF5 ({said}).", "Copy it again from its source."


def read_contents(file: File, path: Path) -> Contents:
    """Look at everything but the pixels."""
    looked = {key: _look(file, key) for key in (DATA, FLATS, DARKS, THETA)}
    angles_from = RECORDED if is_ours(file) else THETA
    looked[angles_from] = _look(file, angles_from)
    datasets = {key: found for key, found in looked.items() if isinstance(found, DatasetFacts)}
    theta = file[angles_from] if angles_from in datasets else None
    return Contents(
        path=path,
        datasets=datasets,
        absent={key: found for key, found in looked.items() if isinstance(found, str)},
        angles=None if theta is None else np.asarray(theta[()]),
        angles_from=angles_from,
        units=None if theta is None else read_units(theta),
        flat_positions=_flat_positions(file, datasets),
        beam=read_beam(file),
    )


def is_ours(file: File) -> bool:
    """Whether the recorded angles were set aside by an earlier run of this program."""
    return RECORDED in file and ACTOR in file


def _look(file: File, key: str) -> DatasetFacts | str:
    """Return the facts of a dataset, or say why it cannot be used."""
    import h5py

    found = file.get(key)
    if isinstance(found, h5py.Dataset):
        return _facts(found)
    if found is not None:
        return "is a group; a dataset is needed"
    link = file.get(key, getlink=True)
    if isinstance(link, h5py.ExternalLink):
        return f"is a link to {link.path} in {link.filename}, which is missing"
    if isinstance(link, h5py.SoftLink):
        return f"is a link to {link.path}, which is missing"
    return "is missing"


def _facts(dataset: Any) -> DatasetFacts:
    return DatasetFacts(
        shape=tuple(dataset.shape or ()),
        dtype=dataset.dtype,
        chunks=dataset.chunks,
        missing_filters=tuple(_missing_filters(dataset)),
        missing_files=tuple(sorted(set(_missing_files(dataset)))),
    )


def _missing_filters(dataset: Any) -> Iterator[str]:
    from h5py import h5z

    plist = dataset.id.get_create_plist()
    for i in range(plist.get_nfilters()):
        code, _, _, label = plist.get_filter(i)
        if not h5z.filter_avail(code) and not _plugins_bring(code):
            yield f"{label.decode() or 'unnamed'} ({code})"


def _plugins_bring(code: int) -> bool:
    """Load the optional collection of filters, for the files that need one."""
    from h5py import h5z

    try:
        import_module("hdf5plugin")
    except ImportError:
        return False
    return bool(h5z.filter_avail(code))


def _missing_files(dataset: Any) -> Iterator[str]:
    """Name the files behind a dataset; HDF5 answers with fill values where they are gone."""
    from pathlib import Path

    names = [name for name, *_ in dataset.external or []]
    if dataset.is_virtual:
        names += [source.file_name for source in dataset.virtual_sources()]
    folder = Path(dataset.file.filename).parent
    for name in names:
        # A single "." means the file itself; "%" a pattern that HDF5 resolves.
        if name != "." and "%" not in name and not (folder / name).exists():
            yield name


def _flat_positions(file: File, datasets: Mapping[str, DatasetFacts]) -> tuple[int, ...]:
    """Say how many projections preceded each flat; all zeros where the file does not tell."""
    if FLATS not in datasets or DATA not in datasets or len(datasets[FLATS].shape) != 3:
        return (0,)
    count, projections = datasets[FLATS].shape[0], datasets[DATA].shape[0]
    located = _located(file)
    if located.count(FLATS) == count and located.count(DATA) == projections:
        before = np.cumsum([place == DATA for place in located])
        return tuple(int(before[i]) for i, place in enumerate(located) if place == FLATS)
    if FLAT_MODE in file and read_text(file[FLAT_MODE][()]).lower() == "both":
        return (0,) * (count // 2) + (projections,) * (count - count // 2)
    return (0,) * count


def _located(file: File) -> list[str]:
    """Return the dataset every frame went to, in order of acquisition."""
    if FRAME_LOCATION not in file or file[FRAME_LOCATION].ndim != 1:
        return []
    return [read_text(place) for place in file[FRAME_LOCATION][()]]
