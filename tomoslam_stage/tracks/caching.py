"""Keypoints kept in files from one run to the next: an interrupted run goes on where it stopped.

Each projection has a file of its own. It holds what its keypoints were made from, as a digest of
the pixels, the parameters, the sources of this folder and the versions of what they call; what was
made from anything else is stale, what does not match its own digest corrupt. Both are made again.
"""

from __future__ import annotations

import logging
import os
from collections import Counter
from dataclasses import dataclass, field
from hashlib import blake2b
from importlib import metadata
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.tracks.detectors import Keypoints

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import Pixels

log = logging.getLogger(__name__)

MAGIC = b"tomoslam keypoints 1\n"
"""Begins every file; its number grows when what follows changes."""
DIGEST = 32
"""Bytes."""
CALLED = ("numpy", "scipy", "opencv-python-headless", "mahotas")
"""Packages whose version may change a keypoint."""
SOURCES = Path(__file__).parents[1]
"""Our own package."""
COLUMNS = ("column", "row", "size", "descriptor")


@dataclass
class KeypointCache:
    """The files of one scan."""

    folder: Path
    """Where they are; made when the first of them is written."""
    made_with: str
    """What decides the keypoints beside the pixels."""
    told: Counter[str] = field(default_factory=Counter)
    """How many were ``taken``, ``new``, ``stale``, ``corrupt``, and how many ``not kept``."""
    _telling: Lock = field(default_factory=Lock)

    @classmethod
    def at(cls, folder: Path, scan: str, made_with: str) -> KeypointCache:
        """Use the folder of this scan in `folder`.

        Raises
        ------
        PipelineError
            If it cannot be made.
        """
        own = folder / scan
        try:
            own.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            found = f"this folder cannot be made ({error.strerror})."
            raise PipelineError(str(own), found, "Choose another with --cache.") from error
        return cls(own, f"{made_with} {_versions()}")

    def keypoints(self, index: int, image: Pixels, find: Callable[[], Keypoints]) -> Keypoints:
        """Return the keypoints of projection `index`: kept from an earlier run, or found now.

        Parameters
        ----------
        index
            Projection.
        image
            (row, column) its line integrals.
        find
            Detects its keypoints.
        """
        path = self.folder / f"{index:06d}.keypoints"
        made_from = blake2b(self.made_with.encode(), digest_size=DIGEST)
        made_from.update(np.ascontiguousarray(image).data)
        kept = self._read(path, made_from.digest())
        if isinstance(kept, Keypoints):
            self._tell("taken")
            return kept
        self._tell(kept)
        found = find()
        self._write(path, made_from.digest(), found)
        return found

    def say(self) -> None:
        """Log what became of the files."""
        told = ", ".join(f"{count} {what}" for what, count in self.told.items())
        bad = self.told["stale"] + self.told["corrupt"] + self.told["not kept"]
        remade = "; what was stale or corrupt was made again" if bad else ""
        level = logging.WARNING if bad else logging.INFO
        log.log(level, "%s: keypoints %s%s", self.folder, told, remade)

    def _tell(self, what: str) -> None:
        with self._telling:
            self.told[what] += 1

    @staticmethod
    def _read(path: Path, made_from: bytes) -> Keypoints | str:
        """Return the keypoints in a file, or what is wrong with it."""
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return "new"
        except OSError:
            return "corrupt"
        head = len(MAGIC)
        names = content[head : head + DIGEST], content[head + DIGEST : head + 2 * DIGEST]
        body = content[head + 2 * DIGEST :]
        if content[:head] != MAGIC or _digest(names[0] + body) != names[1]:
            return "corrupt"
        return _unpacked(body) if names[0] == made_from else "stale"

    def _write(self, path: Path, made_from: bytes, found: Keypoints) -> None:
        """Write a file whole or not at all; a full disk costs the file, not the run."""
        body = _packed(found)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_bytes(MAGIC + made_from + _digest(made_from + body) + body)
            part.replace(path)
        except OSError:
            self._tell("not kept")
        finally:
            part.unlink(missing_ok=True)


def _packed(found: Keypoints) -> bytes:
    stream = BytesIO()
    for name in COLUMNS:
        np.save(stream, getattr(found, name), allow_pickle=False)
    return stream.getvalue()


def _unpacked(body: bytes) -> Keypoints:
    stream = BytesIO(body)
    return Keypoints(*(np.load(stream, allow_pickle=False) for _ in COLUMNS))


def _digest(content: bytes) -> bytes:
    return blake2b(content, digest_size=DIGEST).digest()


def _versions() -> str:
    """Name what detects: our sources by their digest, the rest by version."""
    files = [SOURCES / "images.py", *sorted((SOURCES / "tracks").rglob("*.py"))]
    ours = _digest(b"".join(file.read_bytes() for file in files)).hex()
    return " ".join([ours, *(f"{name} {_version(name)}" for name in CALLED)])


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"
