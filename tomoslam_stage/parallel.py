"""The same work on many items, on all cores, with results in order."""

from __future__ import annotations

import importlib
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from numpy.typing import NDArray

    from tomoslam_stage.products import Pixels

Item = TypeVar("Item")
Result = TypeVar("Result")
Number = TypeVar("Number", bound=np.generic)

BLOCK = 4
"""Rows worked on together: bounds the memory, and is the same for any number of cores."""


@contextmanager
def on_one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread: on several, it rounds as their number goes."""
    # What is loaded later would not hear of the limit.
    importlib.import_module("scipy.linalg")
    with threadpool_limits(1):
        yield


def parallel(
    work: Callable[[Item], Result], items: Collection[Item], what: str = ""
) -> Iterator[Result]:
    """Yield ``work(item)`` for each of `items`, in their order, from one thread for each core.

    Each item is worked on by one thread alone, so that results do not depend on how many there are;
    linear algebra gets no threads of its own meanwhile, which would only stand in the way.
    The listener hears of it where the work has a name, `what`.
    """
    with threadpool_limits(1):
        pool = ThreadPoolExecutor(max_workers=os.cpu_count())
        try:
            results = pool.map(work, items)
            yield from progress(results, what, len(items)) if what else results
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def in_blocks(
    work: Callable[[Pixels], NDArray[Number]], sinograms: Pixels, what: str = ""
) -> NDArray[Number]:
    """(r, ...) what `work` makes of `sinograms` (r, n, column), `BLOCK` rows at a time."""
    blocks = np.split(sinograms, range(BLOCK, len(sinograms), BLOCK))
    return np.concatenate(list(parallel(work, blocks, what)))
