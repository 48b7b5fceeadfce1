"""The same work on many items, on all cores, with results in order."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from tomoslam_stage.progress import progress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")


def parallel(
    work: Callable[[Item], Result], items: Sequence[Item], what: str = ""
) -> Iterator[Result]:
    """Yield ``work(item)`` for each of `items`, in their order, from one thread for each core.

    Each item is worked on by one thread alone, so that results do not depend on how many there are.
    """
    pool = ThreadPoolExecutor(max_workers=os.cpu_count())
    try:
        results = pool.map(work, items)
        yield from progress(results, what, len(items)) if what else results
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
