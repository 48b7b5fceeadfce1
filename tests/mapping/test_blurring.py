"""Edges that a detector's blur hides, given back."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tomoslam_stage.mapping.edges import edge_squares
from tomoslam_stage.mapping.looking import Reading, likeliest, observed

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Known

    from tomoslam_stage.products import Pixels

BLUR = 0.6
ROWS = np.arange(10, 20)
SPREADS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)


@pytest.fixture
def thick(making: Callable[..., Known]) -> tuple[Pixels, Pixels, Known]:
    """Line integrals up to 4, blurred, and as blurred intensities show them."""
    scan = making(rows=30)
    rows = scan.scan.source.read(np.arange(90), np.arange(30))
    sharp = 8 * gaussian_filter(rows, (0, 1.5, 0))
    blur = (0, BLUR, BLUR)
    return gaussian_filter(sharp, blur), -np.log(gaussian_filter(np.exp(-sharp), blur)), scan


def recorded(values: Pixels, like: Known) -> Known:
    return replace(like, scan=replace(like.scan, source=replace(like.scan.source, values=values)))


def test_the_squared_gradient_is_what_blurred_intensities_lack(
    thick: tuple[Pixels, Pixels, Known],
) -> None:
    blurred, seen, like = thick
    missing = (blurred - seen)[:, ROWS].transpose(1, 0, 2)
    squares = edge_squares(recorded(seen, like).scan, ROWS, np.arange(30))
    assert np.corrcoef(missing.ravel(), squares.ravel())[0, 1] > 0.8
    left = missing - BLUR**2 / 2 * squares
    assert np.square(left).mean() < 0.5 * np.square(missing).mean()


def test_rows_that_are_not_usable_are_not_looked_at(thick: tuple[Pixels, Pixels, Known]) -> None:
    _, seen, like = thick
    spoilt = seen.copy()
    spoilt[:, [9, 20]] = np.nan
    squares = edge_squares(recorded(spoilt, like).scan, ROWS, ROWS)
    assert np.isfinite(squares).all()
    whole = edge_squares(recorded(seen, like).scan, ROWS, np.arange(30))
    np.testing.assert_array_equal(squares[1:-1], whole[1:-1])


def test_left_out_projections_tell_whether_edges_are_hidden(
    thick: tuple[Pixels, Pixels, Known],
) -> None:
    found = {}
    for name, values in zip(("none", "hidden"), thick[:2], strict=True):
        scan = recorded(values, thick[2]).scan
        rows = observed(scan, ROWS, np.arange(30), Reading(1, 8.0, 1.5, edges=True))
        found[name] = likeliest(replace(rows, strength=0.02), thick[2].true, SPREADS)
    assert found["none"] == 0
    assert 0.1 <= found["hidden"] <= 0.4
