"""New files that appear whole or not at all."""

from __future__ import annotations

import errno
import logging
import os
import tempfile
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.files import raised_by_hdf5

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from h5py import File


log = logging.getLogger("tomoslam_stage")


@contextmanager
def fresh_file(path: Path) -> Iterator[File]:
    """Yield a new HDF5 file that takes the name `path` once it is complete and on the disk.

    Raises
    ------
    ScanError
        If it cannot be written; nothing is left behind then, and what was there stays.
    """
    import h5py

    with translated(path), fresh_draft(path) as draft, h5py.File(draft, "x") as file:
        yield file
        file.flush()


@contextmanager
def fresh_draft(path: Path) -> Iterator[Path]:
    """Yield a free name beside `path`; what is written there becomes `path` when it is complete."""
    draft = path.with_name(f".{path.name}.tomoslam-new")
    try:
        draft.unlink(missing_ok=True)
        yield draft
        put_in_place(draft, path)
    finally:
        discard(draft)


def check_new_file(path: Path) -> None:
    """Find out whether a file could be made beside `path`, or at it.

    Raises
    ------
    ScanError
        If not.
    """
    with translated(path):
        tempfile.TemporaryFile(dir=path.parent).close()


def put_in_place(draft: Path, path: Path) -> None:
    """Give the finished `draft` the name `path`, safe against a loss of power."""
    with draft.open("rb") as file:
        os.fsync(file.fileno())
    draft.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Bring the names in `folder` onto the disk.

    Where that fails, files are whole all the same, so it is only logged.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        log.warning("%s may not survive a loss of power (%s)", folder, error.strerror)


def discard(draft: Path) -> None:
    """Remove a draft; one that cannot be removed is overwritten by the next run."""
    with suppress(OSError):
        draft.unlink(missing_ok=True)


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line about `path`."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        # HDF5 finds only when it closes a file that the disk was full: a RuntimeError in h5py.
        if isinstance(error, RuntimeError) and not raised_by_hdf5(error):
            raise
        raise ScanError(path.name, *_why_not_written(path, error)) from error


def _why_not_written(path: Path, error: OSError | RuntimeError) -> tuple[str, str]:
    # h5py hands on the number of the error only within its text.
    number, said = getattr(error, "errno", None), str(error)
    if number in (errno.ENOSPC, errno.EDQUOT) or "No space left" in said:
        return f"the disk of {path.parent} is full.", "Free some space there; nothing was changed."
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path.parent} may not be written to.", "Pass --output FILE in a folder of yours."
    if number == errno.ENOENT:
        return f"there is no folder {path.parent}.", "Make it first."
    return f"writing failed ({said}); nothing was changed.", "Pass --output FILE on another disk."
