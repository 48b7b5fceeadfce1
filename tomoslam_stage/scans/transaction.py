"""Editing a scan so that it is all old or all new, whenever the machine stops.

Small files are copied, the copy is edited, checked and given the scan's name. Large ones are
edited in place: HDF5 writes into an `Overlay` in memory, the changed pages go into a journal
beside the scan, and only then into the scan. `recover` finishes what an interruption left, or
removes it where nothing had been decided. Ctrl-C and SIGTERM wait until a step is whole.
"""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import struct
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.fresh import (
    check_new_file,
    discard,
    put_in_place,
    sync_folder,
    translated,
)
from tomoslam_stage.scans.journal import Journal, JournalError, Overlay, draft_of
from tomoslam_stage.stopping import held_back

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from h5py import File

    Step = Callable[[File], None]

log = logging.getLogger("tomoslam_stage")

SMALL = 256 << 20
"""Bytes; files up to here are edited as a copy."""
SYNCED = 64 << 20
"""Bytes of a copy that are brought onto the disk at once."""

ELSEWHERE = "Pass --output FILE to write a file of its own instead."
UNFINISHED = "An edit of it was interrupted, and has to be finished before it is read."


def edit(
    path: Path, change: Step, verify: Step, *, safe_copy: bool = False, way_out: str = ELSEWHERE
) -> None:
    """Apply `change` to the HDF5 file `path` as one transaction.

    Parameters
    ----------
    path
        The file; a symbolic link is followed.
    change
        Edits the open file: links, attributes and small datasets, never pixels.
    verify
        Raises if the edited file, opened anew, is not as it should be.
    safe_copy
        Edit a copy however large the file is: any program can read it all the while.
    way_out
        What to do instead where the file cannot be written to.

    Raises
    ------
    ScanError
        If the file cannot be written or is in use. It is then as it was, or, where writing in
        place was cut short, the message says that the next run will finish it.
    """
    real = _followed(path)
    recover(real)
    by_copy = _by_copy(real, safe_copy)
    with locked(real, way_out, readers=by_copy) as descriptor:
        if by_copy:
            _edit_copy(real, change, verify)
            return
        with held_back():
            _tidy(real, descriptor)
            _edit_in_place(real, descriptor, change, verify)


def recover(path: Path) -> bool:
    """Finish or undo an edit of `path` that was interrupted; return whether there was one.

    Raises
    ------
    ScanError
        If there was one, and it cannot be finished.
    """
    real = _followed(path)
    journal = _journal_of(real)
    if not real.is_file() or not any(left.exists() for left in (journal, *_drafts_of(real))):
        return False
    try:
        # Drafts are of no interest to readers; a journal changes what they read.
        with locked(real, UNFINISHED, readers=not journal.exists()) as descriptor, held_back():
            return _tidy(real, descriptor)
    except ScanError:
        if journal.exists():
            raise
        return False  # drafts do no harm, and may be those of a run that is writing now


def check_writable(path: Path, *, safe_copy: bool = False) -> None:
    """Raise now what would stop `edit` later: permissions, another program's lock, a full disk."""
    real = _followed(path)
    by_copy = real.exists() and _by_copy(real, safe_copy)
    with locked(real, readers=by_copy):
        check_new_file(real)
        size, free = real.stat().st_size, shutil.disk_usage(real.parent).free
        if by_copy and free < size:
            found = f"a copy needs {size / 1e9:.3g} GB in {real.parent}; {free / 1e9:.3g} are free."
            raise ScanError(path.name, found, f"Free some space. {ELSEWHERE}")


@contextmanager
def locked(path: Path, remedy: str = ELSEWHERE, *, readers: bool = False) -> Iterator[int]:
    """Yield a descriptor of `path`, open for reading and writing and locked against others.

    Parameters
    ----------
    path
        The file itself, no link.
    remedy
        What to do if it cannot be.
    readers
        Let those in that only read.

    Raises
    ------
    ScanError
        If it may not be written to, or another program has it open.
    """
    try:
        descriptor = os.open(path, os.O_RDWR)
    except FileNotFoundError as error:
        raise ScanError(path.name, "there is no such file.", f"Looked for {path}.") from error
    except OSError as error:
        found = f"it may not be written to ({error.strerror})."
        raise ScanError(path.name, found, remedy) from error
    try:
        _lock(descriptor, path, remedy, readers)
        yield descriptor
    finally:
        os.close(descriptor)


def _lock(descriptor: int, path: Path, remedy: str, readers: bool) -> None:
    # HDF5 locks by flock, which readers share. The other lock is for runs of this program alone:
    # unlike a plain POSIX lock it stays when h5py closes the file.
    ours = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if readers else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, ours)
    except BlockingIOError as error:
        found = "another program has it open, and has to close it first."
        raise ScanError(path.name, found, remedy) from error
    except OSError as error:
        log.warning("%s: this file system has no locks (%s)", path.name, error.strerror)
    if not os.path.samestat(os.fstat(descriptor), path.stat()):
        raise ScanError(path.name, "it was replaced just now.", "Start again.")


def _followed(path: Path) -> Path:
    """Return the file itself where `path` is a symbolic link; never raises, as `resolve` may."""
    return Path(os.path.realpath(path))


def _by_copy(path: Path, wanted: bool) -> bool:
    """Whether a copy is to take the place of the file.

    Raises
    ------
    ScanError
        If that is wanted, but somebody would notice.
    """
    facts = path.stat()
    if facts.st_nlink > 1:
        why = f"it has {facts.st_nlink} names (hard links), and a copy would take the place of one."
    elif facts.st_uid != os.geteuid() != 0:
        why = "it belongs to another user, and a copy would not."
    else:
        return wanted or facts.st_size <= SMALL
    if wanted:
        raise ScanError(path.name, why, "Leave --safe-copy away, or pass --output FILE.")
    return False


def _edit_copy(path: Path, change: Step, verify: Step) -> None:
    import h5py

    copy = _copy_of(path)
    try:
        with translated(path):
            _copy(path, copy)
            with held_back():
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
        while part := source.read(SYNCED):
            target.write(part)
            target.flush()
            os.fdatasync(target.fileno())  # so that the last sync, which nothing stops, is short
    facts = path.stat()
    with suppress(PermissionError):  # a group of which the user is no member
        os.chown(copy, facts.st_uid, facts.st_gid)
    shutil.copystat(path, copy)
    os.utime(copy)


def _edit_in_place(path: Path, descriptor: int, change: Step, verify: Step) -> None:
    import h5py

    overlay = Overlay(descriptor)
    with translated(path):
        with h5py.File(overlay, "r+") as file:
            change(file)
        with h5py.File(overlay, "r") as file:
            verify(file)
        journal = overlay.journal()
        journal.save(_journal_of(path))
        try:
            journal.append(descriptor)
        except OSError as error:
            if not _taken_back(path, descriptor, journal):
                raise _cut_short(path, error) from error
            raise
    _finish(path, descriptor, journal)


def _taken_back(path: Path, descriptor: int, journal: Journal) -> bool:
    """Cut off what was appended, and forget the journal; return whether that was possible."""
    try:
        os.ftruncate(descriptor, journal.old_size)
        _forget(path)
    except OSError:
        return False
    return True


def _tidy(path: Path, descriptor: int) -> bool:
    """Finish or undo what an earlier run left; return whether there was anything."""
    finished = _finish_journal(path, descriptor)
    drafts = [draft for draft in _drafts_of(path) if draft.exists()]
    for draft in drafts:
        discard(draft)
    if drafts and not finished:
        log.warning("%s: an interrupted edit was found and undone", path.name)
    return finished or bool(drafts)


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
    try:
        journal.append(descriptor)
    except OSError as error:
        raise _cut_short(path, error) from error
    _finish(path, descriptor, journal)
    log.warning("%s: an interrupted edit was found and finished", path.name)
    return True


def _finish(path: Path, descriptor: int, journal: Journal) -> None:
    try:
        journal.overwrite(descriptor)
    except OSError as error:
        raise _cut_short(path, error) from error
    try:
        _forget(path)
    except OSError as error:
        found = f"it is written, but its journal could not be removed ({error.strerror})."
        raise ScanError(path.name, found, f"Remove {_journal_of(path)}.") from error


def _cut_short(path: Path, error: OSError) -> ScanError:
    found = f"writing was cut short ({error.strerror}); what is missing is kept beside it."
    return ScanError(path.name, found, "Make room, and run inspect on it to finish the edit.")


def _forget(path: Path) -> None:
    _journal_of(path).unlink()
    sync_folder(path.parent)


def _journal_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.tomoslam-journal")


def _copy_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.tomoslam-copy")


def _drafts_of(path: Path) -> tuple[Path, ...]:
    """Name what a run leaves that ends before anything is certain."""
    return _copy_of(path), draft_of(_journal_of(path))
