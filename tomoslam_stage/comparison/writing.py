"""Files appear whole or not at all."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from tomoslam_stage.errors import PipelineError

if TYPE_CHECKING:
    from pathlib import Path


def made_folder(folder: Path, option: str = "--report") -> Path:
    """Return `folder`, made with its parents where it is missing; `option` chose it.

    Raises
    ------
    PipelineError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found = f"this folder cannot be made ({error.strerror}); one is needed for what is found."
        raise PipelineError(str(folder), found, f"Choose another with {option}.") from error
    return folder


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` beside `path`, then put it in its place in one step.

    Raises
    ------
    PipelineError
        If it cannot be written; what was at `path` is then still there.
    """
    # A plain open, not tempfile: its files are closed to the group that shares a beamtime.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        found = f"{len(content)} bytes cannot be written ({error.strerror})."
        raise PipelineError(str(path), found, "Choose another folder.") from error
    finally:
        part.unlink(missing_ok=True)
