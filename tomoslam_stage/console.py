"""What a run says while it works: log lines, progress bars on a terminal, a log file."""

from __future__ import annotations

import logging
import sys
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING, TextIO

from tomoslam_stage.progress import heard_by

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.progress import Progress, TaskID

    from tomoslam_stage.progress import Listener

LOGGER = "tomoslam_stage"
PROGRESS = f"{LOGGER}.progress"
SECONDS_BETWEEN_LINES = 10.0
SHARE_BETWEEN_LINES = 0.1

log = logging.getLogger(PROGRESS)


@contextmanager
def logging_to(path: Path | None, verbose: bool) -> Iterator[None]:
    """Send log lines to stderr and, with time stamps and tracebacks, to the file at `path`."""
    logger = logging.getLogger(LOGGER)
    handlers = [_StderrHandler(logging.DEBUG if verbose else logging.INFO), *_file_handlers(path)]
    level = logger.level
    logger.setLevel(logging.DEBUG)
    for handler in handlers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        logger.setLevel(level)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


class _StderrHandler(logging.Handler):
    """Writes to what ``sys.stderr`` is at the time: a live progress bar takes its place."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.setFormatter(_Short())

    def emit(self, record: logging.LogRecord) -> None:
        if record.name == PROGRESS and sys.stderr.isatty():
            return  # a bar says it
        print(self.format(record), file=sys.stderr, flush=True)


class _Short(logging.Formatter):
    """The message; its level only where it is a warning or worse."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        grave = record.levelno >= logging.WARNING
        return f"{record.levelname.lower()}: {record.message}" if grave else record.message


def _file_handlers(path: Path | None) -> list[logging.Handler]:
    if path is None:
        return []
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    return [handler]


def speaks_unicode(stream: TextIO) -> bool:
    """Whether `stream` takes block characters: not all terminals and pipes do."""
    try:
        "▁█°σ".encode(stream.encoding or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def progress_shown() -> Iterator[None]:
    """Show the progress of the work inside the ``with`` block as bars, or as log lines."""
    lines = ProgressLines()
    if not sys.stderr.isatty():
        with heard_by(lines):
            yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as display:
        bars = ProgressBars(display)
        with heard_by(_both(bars, lines)):
            yield


def _both(first: Listener, second: Listener) -> Listener:
    def hear(what: str, done: int, total: int) -> None:
        first(what, done, total)
        second(what, done, total)

    return hear


@dataclass
class ProgressBars:
    """One bar for each work under way; a finished one goes away."""

    display: Progress
    tasks: dict[str, TaskID] = field(default_factory=dict)

    def __call__(self, what: str, done: int, total: int) -> None:
        """Move the bar of this work."""
        if what not in self.tasks:
            self.tasks[what] = self.display.add_task(what, total=total)
        self.display.update(self.tasks[what], completed=done, total=total)
        if done >= total:
            self.display.remove_task(self.tasks.pop(what))


@dataclass
class _Heard:
    """The work that is spoken of, its first news, and what the last line about it said."""

    what: str
    begin: float
    first: int
    said: float
    share: float


@dataclass
class ProgressLines:
    """A log line once both ten seconds and ten percent have passed since the last one."""

    _now: _Heard | None = None

    def __call__(self, what: str, done: int, total: int) -> None:
        """Log a line where one is due."""
        time = monotonic()
        if self._now is None or self._now.what != what or done <= self._now.first:
            self._now = _Heard(what, time, done, time, done / total)
            return
        heard = self._now
        waited = time - heard.said >= SECONDS_BETWEEN_LINES
        if waited and done / total - heard.share >= SHARE_BETWEEN_LINES:
            left = (time - heard.begin) / (done - heard.first) * (total - done)
            log.info("%s: %d of %d, about %.0f s left", what, done, total, left)
            heard.said, heard.share = time, done / total
