"""Opening HDF5 files for reading; what HDF5 says about damage becomes one line."""

from __future__ import annotations

import os
from contextlib import contextmanager
from traceback import walk_tb
from typing import TYPE_CHECKING

from tomoslam_stage.errors import ScanError, StageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from h5py import File

COPY_AGAIN = "Copy it again from its source."


@contextmanager
def open_file(path: Path) -> Iterator[File]:
    """Open `path` for reading; its modification time stays.

    Raises
    ------
    ScanError
        If it is missing, not HDF5, cut off, or held by a writer, and inside the ``with`` block
        where HDF5 itself fails, as it does in a damaged file.
    """
    import h5py

    if not path.is_file():
        raise ScanError(path.name, *_why_no_file(path))
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise ScanError(path.name, *_why_not_opened(path, str(error))) from error
    try:
        with file:
            yield file
    except StageError:
        raise
    except Exception as error:
        if not raised_by_hdf5(error):
            raise
        found = f"reading it failed ({said_by_hdf5(error)})."
        remedy = f"The file is damaged, or its disk is. {COPY_AGAIN}"
        raise ScanError(path.name, found, remedy) from error


def raised_by_hdf5(error: Exception) -> bool:
    """Whether `error` came out of h5py, which has no exception of its own."""
    frames = walk_tb(error.__traceback__)
    return any(frame.f_globals.get("__name__", "").split(".")[0] == "h5py" for frame, _ in frames)


def said_by_hdf5(error: Exception) -> str:
    """Return what HDF5 says went wrong, without the quotes Python puts round a `KeyError`."""
    return str(error.args[0]) if error.args else type(error).__name__


def _why_no_file(path: Path) -> tuple[str, str]:
    if path.is_dir():
        return "it is a folder; an HDF5 file is needed.", "Name the scan in it."
    if path.is_symlink():
        return f"it is a link to {path.readlink()}, which leads nowhere.", "Mend the link."
    if path.exists():
        return "it is no regular file; an HDF5 file is needed.", ""
    return "there is no such file.", f"Looked for {path}."


def _why_not_opened(path: Path, said: str) -> tuple[str, str]:
    if not os.access(path, os.R_OK):
        return "it may not be read by this user.", "Ask for read permission."
    if "truncated" in said:
        return "it is cut off: shorter than its own header says.", COPY_AGAIN
    if "lock" in said:
        return "another program has it open for writing.", "Wait until that program is done."
    if "signature" in said:
        return "it is not an HDF5 file; DXchange in HDF5 is needed.", ""
    return f"it cannot be opened as HDF5 ({said}).", COPY_AGAIN
