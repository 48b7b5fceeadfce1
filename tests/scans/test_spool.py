from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Along, Integers, Pixels
from tomoslam_stage.scans import ArraySource, blocks, spooled
from tomoslam_stage.scans import spool as spooling


@pytest.fixture
def few_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spooling, "BLOCK_PIXELS", 600)


@pytest.fixture
def stack() -> Pixels:
    """(40, 23, 10)"""
    return np.random.default_rng(3).random((40, 23, 10), np.float32)


def doubled(block: Pixels, _rows: Integers) -> Pixels:
    return 2 * block


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize("along", ["projection", "row"])
def test_blocks_cover_every_pixel_once_and_stay_small(along: Along) -> None:
    seen = np.zeros((40, 23), int)
    for projections, rows in blocks((40, 23, 10), along):
        seen[np.ix_(projections, rows)] += 1
        whole = rows if along == "projection" else projections
        assert len(whole) == (23 if along == "projection" else 40)
        assert len(projections) * len(rows) * 10 <= 600 or 1 in (len(projections), len(rows))
    assert (seen == 1).all()


@pytest.mark.parametrize(("length", "expected"), [(0, 1), (1, 1), (15, 15), (16, 16), (47, 32)])
def test_blocks_are_whole_chunks_where_they_are_longer(length: int, expected: int) -> None:
    assert spooling.whole_chunks(length, 16) == expected


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize("along", ["projection", "row"])
def test_prepared_projections_read_back_in_any_order(
    stack: Pixels, along: Along, tmp_path: Path
) -> None:
    spool = spooled(ArraySource(stack), doubled, along, "doubling", tmp_path)
    projections, rows = np.array([39, 0, 7]), np.array([22, 3])
    assert spool.shape == stack.shape
    np.testing.assert_array_equal(
        spool.read(projections, rows), 2 * stack[np.ix_(projections, rows)]
    )


@pytest.mark.usefixtures("few_pixels")
def test_a_preparation_hears_which_rows_it_has(stack: Pixels, tmp_path: Path) -> None:
    def numbered(block: Pixels, rows: Integers) -> Pixels:
        return np.broadcast_to(rows[:, None], block.shape).astype(np.float32)

    spool = spooled(ArraySource(stack), numbered, "row", "numbering", tmp_path)
    everything = spool.read(np.arange(40), np.arange(23))
    np.testing.assert_array_equal(everything[5, :, 2], np.arange(23))


def test_the_temporary_file_has_no_name(stack: Pixels, tmp_path: Path) -> None:
    spool = spooled(ArraySource(stack), doubled, "row", "doubling", tmp_path / "report")
    assert list((tmp_path / "report").iterdir()) == []
    assert spool.read(np.array([0]), np.array([0])).size == 10


def test_a_preparation_may_work_on_a_spool(stack: Pixels, tmp_path: Path) -> None:
    once = spooled(ArraySource(stack), doubled, "row", "doubling", tmp_path)
    twice = spooled(once, doubled, "projection", "doubling", tmp_path)
    np.testing.assert_array_equal(twice.read(np.array([3]), np.arange(23))[0], 4 * stack[3])


@pytest.mark.parametrize("fail", [OSError(28, "No space left on device")])
def test_a_full_disk_is_told_in_one_line(
    stack: Pixels, tmp_path: Path, fail: OSError, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> Callable[..., object]:
        raise fail

    monkeypatch.setattr(spooling, "_fresh", full)
    with pytest.raises(ScanError, match=f"the disk of {tmp_path} is full"):
        spooled(ArraySource(stack), doubled, "row", "doubling", tmp_path)
