"""New files that appear whole or not at all."""

from __future__ import annotations

import errno
import logging
import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from tomoslam_stage.errors import ScanError

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

    draft = path.with_name(f".{path.name}.tomoslam-new")
    try:
        with translated(path):
            draft.unlink(missing_ok=True)
            with h5py.File(draft, "x") as file:
                yield file
                file.flush()
            put_in_place(draft, path)
    finally:
        discard(draft)


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
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        log.warning("%s may not survive a loss of power (%s)", folder, error.strerror)
    finally:
        os.close(descriptor)


def discard(draft: Path) -> None:
    """Remove a draft; one that cannot be removed is overwritten by the next run."""
    with suppress(OSError):
        draft.unlink(missing_ok=True)


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into one line about `path`."""
    try:
        yield
    except OSError as error:
        raise ScanError(path.name, *_why_not_written(path, error)) from error


def _why_not_written(path: Path, error: OSError) -> tuple[str, str]:
    # h5py hands on the number of the error only within its text.
    said = str(error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT) or "No space left" in said:
        return f"the disk of {path.parent} is full.", "Free some space there; nothing was changed."
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path.parent} may not be written to.", "Pass --output FILE in a folder of yours."
    if error.errno == errno.ENOENT:
        return f"there is no folder {path.parent}.", "Make it first."
    return f"writing failed ({said}); nothing was changed.", "Pass --output FILE on another disk."
