"""Changed pages of a large file: collected in memory, kept in a journal, applied in order."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tomoslam_stage.scans.fresh import discard, put_in_place

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

PAGE = 4096
SECTOR = 512
"""A disk writes at least this much at once."""
MAGIC = b"tomoslam_stage journal 1\n"


class JournalError(Exception):
    """A journal that is damaged, or that is not this file's."""


def draft_of(place: Path) -> Path:
    """Where a journal is written before it is complete and called `place`."""
    return place.with_name(f"{place.name}-new")


class Overlay:
    """A file object over a descriptor that keeps every write to itself.

    HDF5 edits metadata through it. Pixels must not be read this way: virtual datasets would
    silently return fill values, and external links fail.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pages: dict[int, bytearray] = {}
        self._old_size = self._size = os.fstat(descriptor).st_size
        self._at = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to `offset` from the start, the present place, or the end."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the present place."""
        return self._at

    def readinto(self, buffer: memoryview) -> int:
        """Fill `buffer` as far as the file reaches; return how far."""
        length = max(0, min(len(buffer), self._size - self._at))
        done = 0
        for page, start, stop in _spans(self._at, length):
            buffer[done : done + stop - start] = self._page(page)[start:stop]
            done += stop - start
        self._at += length
        return length

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes."""
        buffer = bytearray(size)
        return bytes(buffer[: self.readinto(memoryview(buffer))])

    def write(self, data: memoryview) -> int:
        """Keep `data` for the present place."""
        done = 0
        for page, start, stop in _spans(self._at, len(data)):
            kept = self._pages.setdefault(page, bytearray(self._page(page)))
            kept[start:stop] = data[done : done + stop - start]
            done += stop - start
        self._at += done
        self._size = max(self._size, self._at)
        return done

    def truncate(self, size: int) -> int:
        """Set the length of the file; it never falls below the old one."""
        self._size = max(size, self._old_size)
        return self._size

    def flush(self) -> None:
        """Do nothing: the writes stay here."""

    def journal(self) -> Journal:
        """Return what changed."""
        changed = {
            page * PAGE: (_padded(self._descriptor, page), bytes(new))
            for page, new in sorted(self._pages.items())
        }
        pages = {at: both for at, both in changed.items() if both[0] != both[1]}
        return Journal(self._old_size, self._size, pages)

    def _page(self, page: int) -> bytes | bytearray:
        kept = self._pages.get(page)
        return _padded(self._descriptor, page) if kept is None else kept


def _spans(at: int, length: int) -> Iterator[tuple[int, int, int]]:
    """Cut a range of bytes at the pages: page, start and stop within it."""
    end = at + length
    while at < end:
        page, start = divmod(at, PAGE)
        stop = min(PAGE, start + end - at)
        yield page, start, stop
        at += stop - start


def _padded(descriptor: int, page: int) -> bytes:
    return os.pread(descriptor, PAGE, page * PAGE).ljust(PAGE, b"\0")


@dataclass(frozen=True)
class Journal:
    """Old and new bytes of the pages of one edit."""

    old_size: int
    new_size: int
    pages: Mapping[int, tuple[bytes, bytes]]
    """Offset of each page -> its old and its new bytes, padded with zeros behind the end."""

    def save(self, place: Path) -> None:
        """Write the journal to `place`, complete and synced before it has that name."""
        body = b"".join(old + new for old, new in self.pages.values())
        header = {"old_size": self.old_size, "new_size": self.new_size, "pages": [*self.pages]}
        head = json.dumps(header | {"sha256": hashlib.sha256(body).hexdigest()}).encode()
        draft = draft_of(place)
        try:
            draft.unlink(missing_ok=True)
            with draft.open("xb") as file:
                file.write(MAGIC + head + b"\n" + body)
            put_in_place(draft, place)
        finally:
            discard(draft)

    @classmethod
    def load(cls, place: Path) -> Journal:
        """Read a journal.

        Raises
        ------
        JournalError
            If it is not whole.
        """
        magic, _, rest = place.read_bytes().partition(b"\n")
        head, _, body = rest.partition(b"\n")
        try:
            header = json.loads(head)
            whole = hashlib.sha256(body).hexdigest() == header["sha256"]
            offsets, sizes = header["pages"], (header["old_size"], header["new_size"])
        except (ValueError, KeyError, TypeError) as error:
            raise JournalError(f"its journal {place.name} is damaged") from error
        if magic + b"\n" != MAGIC or not whole or len(body) != 2 * PAGE * len(offsets):
            raise JournalError(f"its journal {place.name} is damaged")
        halves = [body[i : i + PAGE] for i in range(0, len(body), PAGE)]
        pages = dict(zip(offsets, zip(halves[::2], halves[1::2], strict=True), strict=True))
        return cls(*sizes, pages)

    def check_belongs(self, descriptor: int) -> None:
        """Check that every sector of the file is as it was before or after the edit.

        Raises
        ------
        JournalError
            If one is neither.
        """
        size = os.fstat(descriptor).st_size
        if not self.old_size <= size <= self.new_size:
            raise JournalError(f"its {size} bytes are not those the journal was made for")
        for at, (old, new) in self.pages.items():
            # Appended bytes hold nothing yet, and a hole reads as zeros.
            now = _padded(descriptor, at // PAGE)
            for cut in range(0, min(PAGE, self.old_size - at), SECTOR):
                part = slice(cut, min(cut + SECTOR, self.old_size - at))
                if now[part] not in (old[part], new[part]):
                    raise JournalError(f"byte {at + cut} was changed by another program since")

    def append(self, descriptor: int) -> None:
        """Write and sync the pages behind the old end; the old file does not know them."""
        for at, (_, new) in self.pages.items():
            if at >= self.old_size:
                _write(descriptor, new[: self.new_size - at], at)
        if os.fstat(descriptor).st_size < self.new_size:
            os.ftruncate(descriptor, self.new_size)
        os.fsync(descriptor)

    def overwrite(self, descriptor: int) -> None:
        """Write and sync the pages within the old file."""
        for at, (_, new) in self.pages.items():
            if at < self.old_size:
                _write(descriptor, new[: self.new_size - at], at)
        os.fsync(descriptor)


def _write(descriptor: int, data: bytes, at: int) -> None:
    """Write all of `data`; the system may take it in parts."""
    left = memoryview(data)
    while left:
        done = os.pwrite(descriptor, left, at)
        left, at = left[done:], at + done
