"""Ctrl-C and SIGTERM: they stop the program where it stands, but never in the middle of an edit."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from threading import current_thread, main_thread
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""What stops the program, and how it says so."""
SECONDS_TO_TIDY = 3.0
"""Signals that come this soon after the first do not disturb what it set off."""


class Stopped(KeyboardInterrupt):
    """A signal asks the program to stop; its notes tell what had been done by then."""

    def __init__(self, number: int) -> None:
        super().__init__(SIGNALS[signal.Signals(number)])
        self.exit_code = 128 + number


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise `Stopped` inside the ``with`` block where a signal asks for it."""
    first = float("-inf")

    def stop(number: int, _frame: FrameType | None) -> None:
        nonlocal first
        if monotonic() - first > SECONDS_TO_TIDY:
            first = monotonic()
            raise Stopped(number)

    with _answering(stop):
        yield


@contextmanager
def held_back() -> Iterator[None]:
    """Finish what is inside the ``with`` block before a signal stops the program."""
    came: list[int] = []
    try:
        with _answering(lambda number, _frame: came.append(number)):
            yield
    finally:
        if came:
            signal.raise_signal(came[0])


@contextmanager
def _answering(answer: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Answer signals with `answer`, but for those that are ignored, as in a shell's background.

    Python hears signals in its main thread only.
    """
    if current_thread() is not main_thread():
        yield
        return
    heard = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, answer) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
