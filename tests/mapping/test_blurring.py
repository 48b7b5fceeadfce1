"""Line integrals that a detector's blur hides, mended."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tomoslam_stage.mapping.blurring import hidden
from tomoslam_stage.mapping.looking import USUAL
from tomoslam_stage.mapping.reading import Reading, likeliest

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Known

    from tomoslam_stage.products import Pixels, Scan

BLUR = 0.6
ROWS, EVERY = np.arange(10, 20), np.arange(30)
BLURS = (0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)


@pytest.fixture
def thick(making: Callable[..., Known]) -> tuple[Pixels, Pixels, Known]:
    """Line integrals up to 4, blurred, and as blurred intensities show them."""
    scan = making(rows=30)
    rows = scan.scan.source.read(np.arange(90), EVERY)
    sharp = 8 * gaussian_filter(rows, (0, 1.5, 0))
    blur = (0, BLUR, BLUR)
    return gaussian_filter(sharp, blur), -np.log(gaussian_filter(np.exp(-sharp), blur)), scan


def recorded(values: Pixels, like: Known) -> Scan:
    return replace(like.scan, source=replace(like.scan.source, values=values))


def reading(values: Pixels, like: Known) -> Reading:
    return Reading(recorded(values, like), EVERY, 1, 8.0, 1.5)


def test_what_a_blur_hides_is_mended(thick: tuple[Pixels, Pixels, Known]) -> None:
    blurred, seen, _ = thick
    missing = blurred - seen
    assert missing.max() > 0.3
    left = (missing - hidden(seen, BLUR))[:, 5:-5]
    assert np.square(left).mean() < 0.05 * np.square(missing[:, 5:-5]).mean()


def test_noise_hides_nothing_and_is_not_raised() -> None:
    noise = np.random.default_rng(4).normal(0, 0.01, (4, 40, 50)).astype(np.float32)
    level = np.float32(1.5)
    assert np.std(hidden(level + noise, BLUR)) < 0.1 * np.std(noise)
    np.testing.assert_allclose(hidden(np.full_like(noise, level), BLUR), 0, atol=1e-5)


def test_rows_are_mended_as_whole_projections_are(thick: tuple[Pixels, Pixels, Known]) -> None:
    _, seen, like = thick
    rows = np.arange(30)  # all of them, so that none stands for its neighbours, too
    found = reading(seen, like).observed(rows, BLUR)
    assert found.blur == BLUR
    wanted = (seen + hidden(seen, BLUR)).transpose(1, 0, 2)
    np.testing.assert_allclose(found.sinograms, wanted, atol=1e-5)


@pytest.mark.parametrize("blur", [0.0, BLUR])
def test_a_row_stands_for_neighbours_that_are_not_read(
    thick: tuple[Pixels, Pixels, Known], blur: float
) -> None:
    _, seen, like = thick
    few = reading(seen, like).observed(np.array([4, 14, 24]), blur).sinograms
    every = reading(seen, like).observed(EVERY, blur).sinograms
    np.testing.assert_allclose(few[1], (every[13] + 2 * every[14] + every[15]) / 4, atol=1e-5)


@pytest.mark.parametrize("blur", [0.0, BLUR])
def test_rows_that_are_not_usable_are_not_looked_at(
    thick: tuple[Pixels, Pixels, Known], blur: float
) -> None:
    _, seen, like = thick
    spoilt = seen.copy()
    spoilt[:, [9, 20]] = np.nan
    some = replace(reading(spoilt, like), usable=ROWS)
    assert np.isfinite(some.observed(ROWS[::3], blur).sinograms).all()


def test_left_out_projections_tell_whether_intensities_were_blurred(
    thick: tuple[Pixels, Pixels, Known],
) -> None:
    found = {}
    for name, values in zip(("none", "blurred"), thick[:2], strict=True):
        how = reading(values, thick[2])
        rows = replace(how.observed(ROWS), strength=USUAL)
        found[name] = likeliest(how, rows, thick[2].true, BLURS)
    assert found["none"] == 0
    assert 0.5 <= found["blurred"] <= 0.7


def test_rows_mended_otherwise_make_maps_in_the_same_way(
    thick: tuple[Pixels, Pixels, Known],
) -> None:
    how = reading(thick[1], thick[2])
    again = how.mended(replace(how.observed(ROWS), faintest=0.1, strength=0.0), BLUR)
    assert (again.blur, again.faintest, again.strength) == (BLUR, 0.1, 0.0)
    np.testing.assert_array_equal(again.sinograms, how.observed(ROWS, BLUR).sinograms)
