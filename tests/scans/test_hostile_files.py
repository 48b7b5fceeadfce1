"""Files that no scan should be: each is answered with one line, and left as it is."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from hostile import (
    COLUMNS,
    DATA,
    PARTS,
    ROWS,
    SHAPE,
    THETA,
    Make,
    N,
    blank_headers,
    but,
    cut,
    damaged,
    elsewhere,
    empty_group,
    filtered,
    linked,
    odd_groups,
    raw_file,
    virtual,
    with_units,
)

from tomoslam_stage.cli import main
from tomoslam_stage.scans import open_scan

NEEDED = "A DXchange file with /exchange/data and /exchange/theta, or an NXtomo entry, is needed."
DAMAGED = "The file is damaged, or its disk is. Copy it again from its source."
CLIPPED = "it is cut off: shorter than its own header says. Copy it again from its source."
FLATS_NEEDED = (
    "flats brighter than the darks are needed. Check which of the two the beam was off for, "
    "or pass --set load_scan.kind=..."
)
TOO_SMALL = "px; at least 3 of 1 x 8 px are needed."


CASES: dict[str, tuple[Make, str]] = {
    "a folder": (Path.mkdir, "it is a folder; an HDF5 file is needed. Name the scan in it."),
    "a pipe": (os.mkfifo, "it is no regular file; an HDF5 file is needed."),
    "a link to nowhere": (
        lambda path: path.symlink_to("gone.h5"),
        "it is a link to gone.h5, which leads nowhere. Mend the link.",
    ),
    "a link to itself": (
        lambda path: path.symlink_to(path.name),
        "it is a link to scan.h5, which leads nowhere. Mend the link.",
    ),
    "no bytes": (Path.touch, "it is not an HDF5 file; DXchange in HDF5 is needed."),
    "another format": (
        lambda path: path.write_bytes(b"II*\0" + bytes(5000)),
        "it is not an HDF5 file; DXchange in HDF5 is needed.",
    ),
    "cut in the middle": (cut(0.5), CLIPPED),
    "one byte lost": (cut(0.99999), CLIPPED),
    "blank headers": (
        blank_headers,
        "reading it failed (Unable to synchronously open object (bad object header version "
        f"number)). {DAMAGED}",
    ),
    "another layout": (elsewhere, f"/exchange/data is missing. {NEEDED}"),
    "no data": (but(data=None), f"/exchange/data is missing. {NEEDED}"),
    "no theta": (but(theta=None), f"/exchange/theta is missing. {NEEDED}"),
    "theta a group": (
        empty_group("/exchange/theta"),
        f"/exchange/theta is a group; a dataset is needed. {NEEDED}",
    ),
    "theta a type": (
        but(theta=np.dtype("f8")),
        f"/exchange/theta is a stored type; a dataset is needed. {NEEDED}",
    ),
    "theta without space": (
        but(theta=h5py.Empty("f8")),
        f"/exchange/theta is empty: a dataset without any space. {NEEDED}",
    ),
    "theta in words": (
        but(theta=[str(angle) for angle in THETA]),
        "/exchange/theta holds texts or lists; real numbers are needed.",
    ),
    "theta in bytes": (
        but(theta=np.full(N, b"1")),
        "/exchange/theta holds texts; real numbers are needed.",
    ),
    "theta in two dimensions": (
        but(theta=THETA[:, None]),
        "/exchange/theta has the shape (24, 1); one dimension is needed.",
    ),
    "theta infinite": (
        but(theta=np.where(THETA == 30, np.inf, THETA)),
        "/exchange/theta holds 1 angles that are NaN or infinite, the first at frame 2; finite "
        "angles are needed. Repair theta, or pass --drop-frames 2.",
    ),
    "theta constant": (
        but(theta=np.full(N, 3.0)),
        "all 24 angles are 3 degrees; a turning stage is needed. Restore theta from the planned "
        "angles.",
    ),
    "theta damaged": (
        damaged("theta", THETA),
        "reading it failed (Can't synchronously read data (filter returned failure during "
        f"read)). {DAMAGED}",
    ),
    "an unknown unit": (
        with_units("gon"),
        "theta has the unit 'gon'; degrees or radians are needed. Pass --set "
        "load_scan.units=deg (or rad).",
    ),
    "degrees called radians": (
        with_units("rad"),
        "theta has the unit rad, in which it spans 54.91 turns; up to 14 are believed unasked. "
        "Pass --set load_scan.units=deg if it holds degrees, or load_scan.units=rad.",
    ),
    "radians called degrees": (
        with_units("deg", np.radians(THETA)),
        "theta spans 6.021 degrees; at least 10 are needed. If it holds radians, pass --set "
        "load_scan.units=rad.",
    ),
    "data a number": (
        but(data=3.0),
        "/exchange/data has 0 dimensions (); three (projection, row, column) are needed.",
    ),
    "data in two dimensions": (
        but(data=DATA[0]),
        "/exchange/data has 2 dimensions (6, 32); three (projection, row, column) are needed.",
    ),
    "data in four dimensions": (
        but(data=DATA[None]),
        "/exchange/data has 4 dimensions (1, 24, 6, 32); three (projection, row, column) are "
        "needed.",
    ),
    "no projections": (
        but(data=DATA[:0]),
        f"/exchange/data holds 0 projections of 6 x 32 {TOO_SMALL}",
    ),
    "one projection": (
        but(data=DATA[:1], theta=THETA[:1]),
        f"/exchange/data holds 1 projections of 6 x 32 {TOO_SMALL}",
    ),
    "no rows": (
        but(data=DATA[:, :0]),
        f"/exchange/data holds 24 projections of 0 x 32 {TOO_SMALL}",
    ),
    "one column": (
        but(data=DATA[..., :1]),
        f"/exchange/data holds 24 projections of 6 x 1 {TOO_SMALL}",
    ),
    "complex data": (
        but(data=DATA.astype(complex)),
        "/exchange/data holds complex numbers; integers or real numbers are needed. Store the "
        "intensity or the line integrals.",
    ),
    "records": (
        but(data=np.zeros(SHAPE, [("a", "f4"), ("b", "f4")])),
        "/exchange/data holds records; integers or real numbers are needed.",
    ),
    "flats of another shape": (
        but(data_white=np.ones((3, ROWS, COLUMNS - 1))),
        "/exchange/data_white has the shape (3, 6, 31); frames of 6 x 32 px, as in "
        "/exchange/data, are needed.",
    ),
    "flats of zeros": (
        but(data_white=np.zeros((3, ROWS, COLUMNS))),
        f"the median of the flats minus the darks is -100 counts; {FLATS_NEEDED}",
    ),
    "flats of NaN": (
        but(data_white=np.full((3, ROWS, COLUMNS), np.nan)),
        f"the median of the flats minus the darks is nan counts; {FLATS_NEEDED}",
    ),
    "darks above flats": (
        but(data_dark=np.full((2, ROWS, COLUMNS), 20_000)),
        f"the median of the flats minus the darks is -1e+04 counts; {FLATS_NEEDED}",
    ),
    "counts without flats": (
        but(data_white=None),
        "/exchange/data holds values up to 8940, which are counts, but there are no flats in "
        "/exchange/data_white; they are needed. Add flats, or pass --set "
        "load_scan.kind=transmission.",
    ),
    "NaN alone": (
        but(data=np.full(SHAPE, np.nan), data_white=None),
        "/exchange/data holds no finite value where it was looked at.",
    ),
    "a link to a file that is gone": (
        linked("/exchange/data", h5py.ExternalLink("gone.h5", "/exchange/data")),
        f"/exchange/data is a link to /exchange/data in gone.h5, which is missing. {NEEDED}",
    ),
    "a link to a dataset that is gone": (
        linked("/exchange/data", h5py.ExternalLink("raw.h5", "/exchange/data"), data=None),
        "/exchange/data is a link to /exchange/data in raw.h5, which has no such dataset. "
        f"{NEEDED}",
    ),
    "a link to another format": (
        linked("/exchange/theta", h5py.ExternalLink("notes.h5", "/theta")),
        f"/exchange/theta is a link to /theta in notes.h5, which is not an HDF5 file. {NEEDED}",
    ),
    "a group that is gone": (
        linked("/exchange", h5py.ExternalLink("gone.h5", "/exchange")),
        "/exchange/data is missing: /exchange is a link to /exchange in gone.h5, which is "
        f"missing. {NEEDED}",
    ),
    "darks that are gone": (
        linked("/exchange/data_dark", h5py.ExternalLink("gone.h5", "/darks")),
        "/exchange/data_dark is a link to /darks in gone.h5, which is missing. Mend it, or "
        "remove it from the file.",
    ),
    "a link that leads to itself": (
        linked("/exchange/data", h5py.SoftLink("/exchange/data")),
        f"/exchange/data is a link to /exchange/data, which is missing. {NEEDED}",
    ),
    "a virtual source that is gone": (
        virtual("gone.h5"),
        "/exchange/data draws on gone.h5, which is missing. Put it back beside the scan.",
    ),
    "a virtual source without the dataset": (
        virtual("raw.h5", data=None),
        "/exchange/data draws on /exchange/data in raw.h5, which is missing. Put it back beside "
        "the scan.",
    ),
    "a virtual source that lost frames": (
        virtual("raw.h5", data=DATA[:10]),
        "/exchange/data draws on /exchange/data in raw.h5, which is shorter than it was. Put it "
        "back beside the scan.",
    ),
    "a raw file that is gone": (
        raw_file,
        "/exchange/data draws on projections.raw, which is missing or too short. HDF5 looks for "
        "it where the program was started: start beside it.",
    ),
    "a filter of hdf5plugin": (
        filtered(32008),
        "/exchange/data is compressed with Bitshuffle (filter 32008), which is not installed. "
        "Install the package hdf5plugin.",
    ),
    "a filter of nobody": (
        filtered(400),
        "/exchange/data is compressed with an unknown filter (filter 400), which is not "
        "installed. Install that filter's HDF5 plugin.",
    ),
}


def left(folder: Path) -> dict[str, tuple[str, int]]:
    """Hash and time of every file that has bytes."""
    return {
        str(path): (hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def without_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)


@pytest.mark.usefixtures("without_plugins")
@pytest.mark.parametrize("case", CASES)
def test_a_hostile_file_is_answered_with_one_line_and_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    make, found = CASES[case]
    path = tmp_path / "scan.h5"
    make(path)
    before, names = left(tmp_path), sorted(tmp_path.rglob("*"))
    assert main([str(path)]) == 3
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines()[-1] == f"error: scan.h5: {found}"
    assert told.err.count("error: ") == 1
    assert "Traceback" not in told.err
    assert main(["inspect", str(path)]) == 3
    told = capsys.readouterr()
    assert f"scan.h5: {found}" in (told.out + told.err)
    assert left(tmp_path) == before
    assert sorted(tmp_path.rglob("*")) == names


GOOD: dict[str, Make] = {
    "half precision": but(data=(DATA / 4).astype("f2"), data_white=np.full((1, 6, 32), 3e3, "f2")),
    "big-endian": but(data=DATA.astype(">u2")),
    "one row": but(**{k: v if k == "theta" else v[:, :1] for k, v in PARTS.items()}),
    "dead and hot pixels": but(
        data=np.where(np.arange(COLUMNS) == 5, 0, np.where(np.arange(COLUMNS) == 9, 65535, DATA))
    ),
    "whole numbers for angles": but(theta=THETA.astype(int)),
    "radians": with_units("rad", np.radians(THETA)),
    "units without space": with_units(h5py.Empty("S4")),
    "links to another file": linked("/exchange", h5py.ExternalLink("raw.h5", "/exchange")),
    "virtual projections": virtual("raw.h5"),
    "groups where texts should be": odd_groups,
}


@pytest.mark.parametrize("case", GOOD)
def test_an_odd_but_sound_file_is_read_and_left_alone(tmp_path: Path, case: str) -> None:
    folder = tmp_path / "скан 1 – Über"
    folder.mkdir()
    path = folder / "a b, ü.h5"
    GOOD[case](path)
    before = left(tmp_path)
    opened = open_scan(path)
    values = opened.source.read(np.arange(N), np.arange(opened.n_rows))
    np.testing.assert_allclose(np.degrees(opened.theta), THETA)
    assert np.isfinite(values).all()
    assert np.ptp(values) > 0.1
    assert left(tmp_path) == before
