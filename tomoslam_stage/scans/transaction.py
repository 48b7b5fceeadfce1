"""Editing a scan so that it is all old or all new, whenever the machine stops.

Small files are copied, the copy is edited, checked and given the scan's name. Large ones are
edited in place: HDF5 writes into an `Overlay` in memory, the changed pages go into a journal
beside the scan, and only then into the scan. `recover` finishes what an interruption left.
"""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.fresh import discard, put_in_place, sync_folder, translated
from tomoslam_stage.scans.journal import Journal, JournalError, Overlay

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from h5py import File

    Step = Callable[[File], None]

log = logging.getLogger("tomoslam_stage")

SMALL = 256 << 20
"""Bytes; files up to here are edited as a copy."""


def edit(path: Path, change: Step, verify: Step) -> None:
    """Apply `change` to the HDF5 file `path` as one transaction.

    Parameters
    ----------
    path
        The file; a symbolic link is followed.
    change
        Edits the open file: links, attributes and small datasets, never pixels.
    verify
        Raises if the edited file, opened anew, is not as it should be.

    Raises
    ------
    ScanError
        If the file cannot be written or is in use. It is then as it was, or, where writing in
        place was cut short, the message says that the next run will finish it.
    """
    real = path.resolve()
    with locked(real) as descriptor:
        _finish_journal(real, descriptor)
        if _replaceable(real):
            _edit_copy(real, change, verify)
        else:
            _edit_in_place(real, descriptor, change, verify)


def recover(path: Path) -> bool:
    """Finish an edit of `path` that was interrupted; return whether there was one.

    Raises
    ------
    ScanError
        If there was one, and it cannot be finished.
    """
    real = path.resolve()
    if not _journal_of(real).exists() or not real.exists():
        return False
    with locked(real) as descriptor:
        return _finish_journal(real, descriptor)


def check_writable(path: Path) -> None:
    """Raise now what would stop `edit` later: permissions, or another program's lock."""
    real = path.resolve()
    with locked(real):
        if not os.access(real.parent, os.W_OK):
            raise ScanError(
                path.name,
                f"new files may not be made in {real.parent}, which editing safely needs.",
                "Pass --output FILE in a folder of yours.",
            )


@contextmanager
def locked(path: Path) -> Iterator[int]:
    """Yield a descriptor of `path`, open for reading and writing and locked against others."""
    try:
        descriptor = os.open(path, os.O_RDWR)
    except FileNotFoundError as error:
        raise ScanError(path.name, "there is no such file.", f"Looked for {path}.") from error
    except OSError as error:
        found = f"it may not be written to ({error.strerror})."
        raise ScanError(path.name, found, "Pass --output FILE in a folder of yours.") from error
    try:
        _lock(descriptor, path)
        yield descriptor
    finally:
        os.close(descriptor)


def _lock(descriptor: int, path: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        found = "another program has it open."
        raise ScanError(path.name, found, "Close it there, or pass --output FILE.") from error
    except OSError as error:
        log.warning("%s: this file system has no locks (%s)", path.name, error.strerror)
    if not os.path.samestat(os.fstat(descriptor), path.stat()):
        raise ScanError(path.name, "it was replaced just now.", "Start again.")


def _replaceable(path: Path) -> bool:
    """Whether a copy can take the place of the file without anyone noticing."""
    facts = path.stat()
    mine = facts.st_uid == os.geteuid() or os.geteuid() == 0
    return facts.st_size <= SMALL and facts.st_nlink == 1 and mine


def _edit_copy(path: Path, change: Step, verify: Step) -> None:
    import h5py

    copy = path.with_name(f".{path.name}.tomoslam-copy")
    try:
        with translated(path):
            _copy(path, copy)
            with h5py.File(copy, "r+") as file:
                change(file)
                file.flush()
            with h5py.File(copy, "r") as file:
                verify(file)
            put_in_place(copy, path)
    finally:
        discard(copy)


def _copy(path: Path, copy: Path) -> None:
    """Copy bytes, permissions, owner and extended attributes."""
    copy.unlink(missing_ok=True)
    with path.open("rb") as source, copy.open("xb") as target:
        shutil.copyfileobj(source, target, 1 << 24)
    facts = path.stat()
    with suppress(PermissionError):  # a group of which the user is no member
        os.chown(copy, facts.st_uid, facts.st_gid)
    shutil.copystat(path, copy)
    os.utime(copy)


def _edit_in_place(path: Path, descriptor: int, change: Step, verify: Step) -> None:
    import h5py

    overlay = Overlay(descriptor)
    with h5py.File(overlay, "r+") as file:
        change(file)
    with h5py.File(overlay, "r") as file:
        verify(file)
    journal = overlay.journal()
    with translated(path):
        journal.save(_journal_of(path))
        try:
            journal.append(descriptor)
        except OSError:
            # Whoever cannot even cut the file back leaves the journal to the next run.
            with suppress(OSError):
                os.ftruncate(descriptor, journal.old_size)
                _forget(path)
            raise
    _finish(path, descriptor, journal)


def _finish_journal(path: Path, descriptor: int) -> bool:
    """Finish what a journal beside `path` says; return whether there was one."""
    place = _journal_of(path)
    if not place.exists():
        return False
    try:
        journal = Journal.load(place)
        journal.check_belongs(descriptor)
    except JournalError as error:
        remedy = f"Look at both files before removing {place}."
        raise ScanError(path.name, f"an edit was interrupted, but {error}.", remedy) from error
    with translated(path):
        journal.append(descriptor)
    _finish(path, descriptor, journal)
    log.warning("%s: an interrupted edit was found and finished", path.name)
    return True


def _finish(path: Path, descriptor: int, journal: Journal) -> None:
    try:
        journal.overwrite(descriptor)
    except OSError as error:
        found = f"writing was cut short ({error.strerror}); what is missing is kept beside it."
        raise ScanError(path.name, found, "Run inspect on it to finish the edit.") from error
    try:
        _forget(path)
    except OSError as error:
        found = f"it is written, but its journal could not be removed ({error.strerror})."
        raise ScanError(path.name, found, f"Remove {_journal_of(path)}.") from error


def _forget(path: Path) -> None:
    _journal_of(path).unlink()
    sync_folder(path.parent)


def _journal_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.tomoslam-journal")
