"""Arrays that are no numpy arrays, angles that are no radians, and what a notebook shows."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tomoslam_stage import compare, reconstruct, refine_theta
from tomoslam_stage.errors import ScanError
from tomoslam_stage.products import Event, Refinement
from tomoslam_stage.scans import scan_of

ROWS, SOME = np.array([3, 40, 41]), np.array([70, 2, 2])


class Uneven:
    """Stands in for a dask array: read where it is computed, chunks of different sizes."""

    def __init__(self, array: np.ndarray) -> None:
        self.array, self.shape = array, array.shape
        self.chunks = ((40, 50), (96,), (100, 28))
        self.chunksize = (50, 96, 100)

    def __getitem__(self, index: Any) -> Uneven:
        assert all(isinstance(each, slice) for each in index)
        return Uneven(self.array[index])

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return self.array.astype(dtype or self.array.dtype)


def as_hdf5(array: np.ndarray, folder: Path) -> Any:
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("a", data=array, chunks=(7, 9, 128))
    return h5py.File(folder / "a.h5")["a"]


def as_dask(array: np.ndarray, _folder: Path) -> Any:
    dask = pytest.importorskip("dask.array", reason="a check of the neighbour; installed by hand")
    return dask.from_array(array, chunks=(40, 96, 100))


@pytest.mark.parametrize("made", [as_hdf5, as_dask, lambda array, _: Uneven(array)])
def test_any_array_with_slices_is_read_as_numpy_would_be(
    integrals: np.ndarray, tmp_path: Path, made: Any
) -> None:
    theta = np.linspace(0, 6, 90)
    other = made(integrals, tmp_path)
    read = scan_of(other, theta).source.read(SOME, ROWS)
    np.testing.assert_array_equal(read, integrals[np.ix_(SOME, ROWS)])
    slices = [
        reconstruct(each, theta, 65.0, rows=[40], backend="embedded") for each in (integrals, other)
    ]
    np.testing.assert_array_equal(*slices)


def test_degrees_are_not_taken_for_radians(integrals: np.ndarray) -> None:
    with pytest.raises(ScanError, match=r"span 56\.66 turns\. Pass numpy\.radians\(theta\)"):
        refine_theta(integrals, np.arange(90) * 4.0)


class Tags(HTMLParser):
    """Every tag of a piece of HTML, and whether each was closed."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.seen.add(tag)
        if tag not in ("polygon", "polyline"):
            self.open.append(tag)
        assert not {"src", "href", "onclick"} & dict(attrs).keys()

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("polygon", "polyline"):
            assert self.open.pop() == tag


@pytest.mark.parametrize("sigma", [1e-4, np.nan])
def test_a_notebook_shows_verdict_events_and_correction(refined: Refinement, sigma: float) -> None:
    event = Event(45, 2.5, 30.0, "lost step")
    shown = replace(
        refined, reason="a < b", events=(event,), sigma=np.full(90, sigma)
    )._repr_html_()
    tags = Tags()
    tags.feed(shown)
    assert tags.open == []
    assert {"table", "svg", "polyline"} <= tags.seen
    assert "a &lt; b" in shown
    assert "lost step at 45" in shown
    assert "nan" not in shown
    assert len(shown) < 20_000


def test_compared_slices_draw_themselves(integrals: np.ndarray, refined: Refinement) -> None:
    made = [
        reconstruct(integrals, theta, 65.5, rows=[40, 60], backend="embedded")
        for theta in (refined.recorded, refined.refined)
    ]
    found = compare(*made)
    figures = found.figures()
    assert len(figures) == 2
    titles = [axes.get_title() for axes in figures[0].axes]
    assert {"recorded angles", "refined angles"} <= set(titles)
    assert found.sharpness
