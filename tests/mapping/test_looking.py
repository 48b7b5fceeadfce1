from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.mapping import looking
from tomoslam_stage.mapping.looking import Observed, strongest, truncated
from tomoslam_stage.mapping.reading import Reading
from tomoslam_stage.products import Geometry

if TYPE_CHECKING:
    from conftest import Blobs, Known

    from tomoslam_stage.products import Floats, Pixels, Scan

STRENGTHS = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15)
THETA = np.arange(60) * np.pi / 30
START = Geometry(THETA, 64.8, np.deg2rad(0.2), 30.0)
JITTERED = replace(
    START, shift=np.random.default_rng(8).normal(0, 0.5, 60), unknowns=("theta", "axis", "shift")
)


def rows_of(scan: Scan, count: int, binning: int = 1) -> Observed:
    """Read the first `count` rows, every one for itself."""
    first = np.arange(count)
    return Reading(scan, first, binning, 8.0, 1.5).observed(first)


@pytest.fixture
def fixed(blobs: Blobs, monkeypatch: pytest.MonkeyPatch) -> Observed:
    """Three rows of blobs, and a map of them that stays as it is."""
    monkeypatch.setattr(looking, "mapped", lambda *_, **__: blobs.slices(64))
    wrong = THETA + np.deg2rad(2) * np.random.default_rng(7).standard_normal(60)
    return Observed(blobs.sinograms(wrong, 32.0, 64), np.array([0, 20, 70]), 2, 8.0)


@pytest.mark.parametrize(
    ("start", "unknown"),
    [(START, k) for k in (0, 17, 59, 60, 61)] + [(JITTERED, k) for k in (17, 60, 62, 80, 121)],
)
def test_the_pull_is_the_slope_of_the_residual(
    fixed: Observed, start: Geometry, unknown: int
) -> None:
    step = np.zeros(start.layout.size)
    step[unknown] = {60: 0.02, 61: 0.02 / 40}.get(unknown, 0.05 if unknown > 61 else 0.001)

    def residual(geometry: Geometry) -> Floats:
        return np.asarray(64 * fixed.look(geometry).squares.sum(axis=1))

    slope = (residual(start.moved(step)) - residual(start.moved(-step))) / (2 * step[unknown])
    wanted = fixed.look(start).pulls[:, unknown]
    np.testing.assert_allclose(-slope / 2, wanted, rtol=0.02, atol=0.02 * np.abs(wanted).max())


def test_the_conditional_curvature_is_that_of_a_map_that_stays(fixed: Observed) -> None:
    look = fixed.look(START)
    assert look.conditional.shape == (62,)
    axis = np.array([*np.zeros(60), 1.0, 0.0])
    after, before = (fixed.look(START.moved(off * axis)).pull[60] for off in (0.05, -0.05))
    # Gauss and Newton: the residual's own part of the curvature is left out.
    assert (before - after) / 0.1 == pytest.approx(look.conditional[60], rel=0.2)


def test_what_is_fixed_to_the_detector_pulls_nothing(fixed: Observed) -> None:
    pattern = np.random.default_rng(9).normal(0, 0.1, (3, 1, 64)).astype(np.float32)
    clean, ringing = (
        one.look(START) for one in (fixed, replace(fixed, sinograms=fixed.sinograms + pattern))
    )
    np.testing.assert_allclose(ringing.squares, clean.squares, rtol=1e-3)
    off = ringing.pulls - clean.pulls
    assert np.abs(off).max() < 1e-3 * np.abs(clean.pulls).max()
    assert ringing.fixed > clean.fixed + 1e-3


def test_all_shifts_together_are_the_axis(fixed: Observed) -> None:
    look, parts = fixed.look(JITTERED), JITTERED.layout
    np.testing.assert_allclose(look.pulls[:, parts.shifts].sum(axis=1), look.pulls[:, parts.axis])
    assert look.conditional[parts.shifts].sum() == pytest.approx(look.conditional[parts.axis])
    # The angle and the shift of a projection are two directions, not one.
    both = look.conditional[parts.angles] * look.conditional[parts.shifts]
    assert (look.mixed**2 < both).all()
    assert (look.mixed**2).max() > 1e-3 * both.max()


def disc_rows(rng: np.random.Generator) -> Pixels:
    """(4, n, column) of a few discs of one density, and noise."""
    u = np.arange(64) - 31.5
    sinograms = np.zeros((4, 90, 64))
    theta = np.arange(90) * np.pi / 45
    for row in sinograms:
        for x, z, radius in rng.uniform([-14, -14, 4], [14, 14, 10], (4, 3)):
            off = u - (x * np.cos(theta) + z * np.sin(theta))[:, None]
            row[...] += 2 * np.sqrt(np.maximum(radius**2 - off**2, 0))
    return (sinograms + rng.normal(0, 1, sinograms.shape)).astype(np.float32)


def test_the_prior_grows_where_blocks_are_seen_through_noise(walk: Known) -> None:
    theta = np.arange(90) * np.pi / 45
    blocks = Observed(disc_rows(np.random.default_rng(3)), np.arange(4), 1, 8.0)
    few = rows_of(walk.scan, 4)
    fine = strongest(few, walk.true, STRENGTHS)
    assert strongest(blocks, Geometry(theta, 31.5), STRENGTHS) > 2 * fine


def test_an_object_that_goes_on_beyond_the_detector_gets_a_wider_map(walk: Known) -> None:
    whole = rows_of(walk.scan, 4)
    assert whole.extent == 1.0
    cut = replace(walk.scan, source=type(walk.scan.source)(walk.scan.source.values[..., 16:48]))
    assert rows_of(cut, 4).extent == 1.5


def test_what_shows_nothing_is_not_truncated() -> None:
    assert not truncated(np.zeros((2, 30, 40), np.float32))


def test_rows_that_are_few_are_a_part_of_those_that_are_many(walk: Known) -> None:
    whole = rows_of(walk.scan, 12, binning=2)
    part = whole.part(5)
    assert len(part.rows) == 5
    assert np.array_equal(part.sinograms[1], whole.sinograms[part.rows[1]])
