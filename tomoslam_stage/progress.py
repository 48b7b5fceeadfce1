"""Progress of long work, told to whoever listens (a terminal bar, a log file, nobody)."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Item = TypeVar("Item")


class Listener(Protocol):
    """Hears that `done` of `total` pieces of the work called `what` are finished."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """Take note."""
        ...


_listener: ContextVar[Listener | None] = ContextVar("progress_listener", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Send the progress of everything inside the ``with`` block to `listener`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def progress(items: Iterable[Item], what: str, total: int) -> Iterator[Item]:
    """Yield `items` and tell the listener after each one."""
    listener = _listener.get()
    for done, item in enumerate(items, start=1):
        yield item
        if listener is not None:
            listener(what, done, total)
