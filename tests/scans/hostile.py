"""Makers of files that are wrong in one respect, each of them a function of the path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

SHAPE = N, ROWS, COLUMNS = 24, 6, 32
DATA = np.random.default_rng(1).integers(1000, 9000, SHAPE, np.uint16)
THETA = np.arange(N) * 15.0
PARTS = {
    "data": DATA,
    "theta": THETA,
    "data_white": np.full((3, ROWS, COLUMNS), 10_000, np.uint16),
    "data_dark": np.full((2, ROWS, COLUMNS), 100, np.uint16),
}

Make = Callable[[Path], object]


def scan(path: Path, **parts: Any) -> None:
    """Write a sound scan but for `parts`; None leaves one out."""
    with h5py.File(path, "w") as file:
        for name, value in {**PARTS, **parts}.items():
            if value is not None:
                file[f"/exchange/{name}"] = value
        theta = file["exchange"].get("theta")
        if isinstance(theta, h5py.Dataset):
            theta.attrs["units"] = "deg"


def but(**parts: Any) -> Make:
    return lambda path: scan(path, **parts)


def with_units(units: Any, theta: Any = THETA) -> Make:
    def make(path: Path) -> None:
        scan(path, theta=theta)
        with h5py.File(path, "r+") as file:
            file["/exchange/theta"].attrs["units"] = units

    return make


def linked(place: str, link: Any, **beside: Any) -> Make:
    """Put a link at `place`; ``raw.h5`` beside it is a sound scan but for `beside`."""

    def make(path: Path) -> None:
        scan(path.with_name("raw.h5"), **beside)
        path.with_name("notes.h5").write_text("exposure 0.1 s")
        scan(path)
        with h5py.File(path, "r+") as file:
            del file[place]
            file[place] = link

    return make


def virtual(source: str, **beside: Any) -> Make:
    """Draw the first half of the projections on `source` and the rest on the scan beside."""

    def make(path: Path) -> None:
        scan(path.with_name("raw.h5"), **beside)
        layout = h5py.VirtualLayout(SHAPE, np.uint16)
        layout[:10] = h5py.VirtualSource(source, "/exchange/data", SHAPE)[:10]
        layout[10:] = h5py.VirtualSource("raw.h5", "/exchange/data", SHAPE)[10:]
        scan(path, data=None)
        with h5py.File(path, "r+") as file:
            file.create_virtual_dataset("/exchange/data", layout)

    return make


def filtered(code: int) -> Make:
    """Say that the projections went through a filter, which nobody here has."""

    def make(path: Path) -> None:
        scan(path, data=None)
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((1, ROWS, COLUMNS))
        plist.set_filter(code, h5py.h5z.FLAG_OPTIONAL)
        with h5py.File(path, "r+") as file:
            space = h5py.h5s.create_simple(SHAPE)
            h5py.h5d.create(file["exchange"].id, b"data", h5py.h5t.NATIVE_UINT16, space, plist)

    return make


def raw_file(path: Path) -> None:
    scan(path, data=None)
    with h5py.File(path, "r+") as file:
        pieces = [("projections.raw", 0, DATA.nbytes)]
        file.create_dataset("/exchange/data", SHAPE, np.uint16, external=pieces)


def cut(size: float) -> Make:
    def make(path: Path) -> None:
        scan(path)
        path.write_bytes(path.read_bytes()[: int(size * path.stat().st_size)])

    return make


def damaged(name: str, value: Any) -> Make:
    """Overwrite compressed bytes of a dataset."""

    def make(path: Path) -> None:
        scan(path, **{name: None})
        with h5py.File(path, "r+") as file:
            made = file["exchange"].create_dataset(name, data=value, chunks=True, compression=4)
            made.attrs["units"] = "deg"
            at = made.id.get_chunk_info(0).byte_offset
        content = bytearray(path.read_bytes())
        content[at + 2 : at + 20] = b"\xff" * 18
        path.write_bytes(content)

    return make


def empty_group(place: str) -> Make:
    def make(path: Path) -> None:
        scan(path, theta=None) if place.endswith("theta") else scan(path, data=None)
        with h5py.File(path, "r+") as file:
            file.create_group(place)

    return make


def odd_groups(path: Path) -> None:
    scan(path)
    with h5py.File(path, "r+") as file:
        for place in ("defaults/HDF5FrameLocation", "process/acquisition/flat_fields"):
            file.create_group(f"{place}/flat_field_mode")
        file["measurement"] = 3


def elsewhere(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["/entry1/tomo_entry/data/rotation_angle"] = THETA


def blank_headers(path: Path) -> None:
    scan(path)
    content = bytearray(path.read_bytes())
    content[800:2100] = bytes(1300)
    path.write_bytes(content)
