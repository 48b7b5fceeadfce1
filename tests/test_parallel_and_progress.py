from __future__ import annotations

import os
import threading
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from tomoslam_stage.parallel import BLOCK, in_blocks, on_one_thread, parallel
from tomoslam_stage.products import Pixels
from tomoslam_stage.progress import heard_by, progress

Told = list[tuple[str, int, int]]


@pytest.fixture
def told() -> Told:
    return []


def test_results_come_in_the_order_of_the_items(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)

    def slow_first(item: int) -> int:
        time.sleep(0.02 * (item == 0))
        return item**2

    assert list(parallel(slow_first, range(20))) == [k**2 for k in range(20)]


def test_linear_algebra_keeps_to_one_thread_whatever_the_machine_has() -> None:
    with threadpool_limits(3), on_one_thread():
        pools = threadpool_info()
        assert pools
        assert {pool["num_threads"] for pool in pools} == {1}


def test_no_items_give_no_results() -> None:
    assert list(parallel(str, [], "nothing")) == []


def test_work_is_done_by_as_many_threads_as_there_are_cores(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    everyone = threading.Barrier(3, timeout=5)

    def meet(_: int) -> int:
        everyone.wait()
        return threading.get_ident()

    threads = set(parallel(meet, range(9)))
    assert len(threads) == 3
    assert threading.get_ident() not in threads


def test_what_goes_wrong_in_the_work_is_raised_and_the_rest_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    begun = []

    def fail_third(item: int) -> int:
        begun.append(item)
        if item == 2:
            raise ZeroDivisionError("item 2")
        time.sleep(0.005 * (item > 2))
        return item

    results = parallel(fail_third, range(200))
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ZeroDivisionError, match="item 2"):
        next(results)
    count = len(begun)
    assert count < 100
    time.sleep(0.02)
    assert len(begun) == count, "no thread works on"


def test_who_stops_asking_stops_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    begun = []

    def work(item: int) -> int:
        begun.append(item)
        time.sleep(0.005)
        return item

    results = parallel(work, range(200))
    assert next(results) == 0
    results.close()
    count = len(begun)
    assert count < 100
    time.sleep(0.02)
    assert len(begun) == count


def test_the_listener_hears_of_work_that_has_a_name(told: Told) -> None:
    with heard_by(lambda *news: told.append(news)):
        list(parallel(abs, [1, 2]))
        assert told == []
        list(parallel(abs, [1, 2], "making positive"))
    assert told == [("making positive", 1, 2), ("making positive", 2, 2)]


@pytest.mark.parametrize(("rows", "sizes"), [(1, [1]), (4, [4]), (5, [4, 1]), (9, [4, 4, 1])])
@pytest.mark.parametrize("cores", [1, 3])
def test_blocks_are_the_same_for_any_number_of_cores(
    rows: int, sizes: list[int], cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    sinograms = np.arange(rows * 6, dtype=np.float32).reshape(rows, 3, 2)
    seen: list[int] = []

    def summed(block: Pixels) -> Pixels:
        seen.append(len(block))
        return block.sum(axis=-1)

    found = in_blocks(summed, sinograms)
    np.testing.assert_array_equal(found, sinograms.sum(axis=-1))
    assert sorted(seen, reverse=True) == sizes
    assert max(seen) <= BLOCK


def test_the_listener_hears_of_blocks(told: Told) -> None:
    with heard_by(lambda *news: told.append(news)):
        in_blocks(np.negative, np.zeros((9, 2, 2), np.float32), "turning over")
    assert told == [("turning over", k, 3) for k in (1, 2, 3)]


def test_progress_is_told_after_each_item_is_done_with(told: Told) -> None:
    with heard_by(lambda *news: told.append(news)):
        for item in progress("abc", "spelling", 3):
            assert len(told) == "abc".index(item)
    assert told == [("spelling", k, 3) for k in (1, 2, 3)]


def test_items_pass_when_nobody_listens() -> None:
    assert list(progress(iter("abc"), "spelling", 3)) == ["a", "b", "c"]


def test_the_nearest_listener_hears_and_the_one_before_it_is_back_even_after_an_error(
    told: Told,
) -> None:
    inner: Told = []

    def fail() -> None:
        with heard_by(lambda *news: inner.append(news)):
            list(progress([1], "inside", 1))
            raise KeyError

    with heard_by(lambda *news: told.append(news)):
        with pytest.raises(KeyError):
            fail()
        list(progress([1], "outside", 1))
    list(progress([1], "nobody", 1))
    assert inner == [("inside", 1, 1)]
    assert told == [("outside", 1, 1)]
