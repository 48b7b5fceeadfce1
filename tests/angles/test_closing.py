"""Loops close where half a turn on the mirror image is seen, and a full turn on the same."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.angles import LoopClosure
from tomoslam_stage.geometry import rms

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Closures, Floats, Pixels

AXIS = 46.3
COLUMNS = 96


@pytest.fixture(scope="module")
def crowd(dots: Blobs) -> Blobs:
    """Sixty small blobs in sixteen rows, of other heights in each."""
    return replace(dots, height=np.random.default_rng(3).uniform(0.02, 0.1, (16, 60)))


def seen(crowd: Blobs, theta: Floats, noise: float = 0.005) -> Pixels:
    clean = crowd.sinograms(theta, AXIS, COLUMNS)
    return clean + np.random.default_rng(8).normal(0, noise, clean.shape).astype(np.float32)


def errors(closures: Closures, true: Floats) -> Floats:
    """(m,) radians: by how much each closure misplaces its projection."""
    last, near, beside = true[closures.projections].T
    between = (1 - closures.share) * near + closures.share * beside
    return np.asarray(last - closures.turn - between)


def walk(n: int, span: float, step_deg: float = 0.05) -> tuple[Floats, Floats]:
    recorded = np.arange(n) * span / n
    drift = np.cumsum(np.random.default_rng(5).normal(0, np.deg2rad(step_deg), n))
    return recorded, recorded + drift


@pytest.mark.parametrize("span", [2 * np.pi, 4 * np.pi])
def test_closures_say_where_projections_lie_and_how_sure_that_is(crowd: Blobs, span: float) -> None:
    recorded, true = walk(180 * round(span / np.pi), span)
    found = LoopClosure().measure(seen(crowd, true), recorded, AXIS)
    assert len(found) > 0.9 * (len(recorded) - 180)
    off = errors(found, true)
    assert np.rad2deg(rms(off)) < 0.05
    assert 0.5 < rms(off / found.sigma) < 1.6
    assert np.rad2deg(rms(off)) < 0.2 * np.rad2deg(rms(errors(found, recorded)))


def test_noise_does_not_pull_a_projection_to_the_nearest_other_one(crowd: Blobs) -> None:
    recorded = np.arange(360) * np.pi / 180
    true = np.where(recorded < np.pi, recorded, recorded + np.deg2rad(0.3))
    found = LoopClosure().measure(seen(crowd, true, noise=0.1), recorded, AXIS)
    away = (found.share * np.diff(recorded)[0])[np.abs(errors(found, true)) < np.deg2rad(0.5)]
    assert np.rad2deg(np.median(away)) == pytest.approx(0.3, abs=0.05)


def test_the_order_of_the_projections_does_not_matter(crowd: Blobs) -> None:
    recorded, true = walk(200, 2 * np.pi)
    mixed = np.random.default_rng(2).permutation(200)
    plain = LoopClosure().measure(seen(crowd, true, 0.0), recorded, AXIS)
    again = LoopClosure().measure(seen(crowd, true[mixed], 0.0), recorded[mixed], AXIS)
    assert {tuple(mixed[p]) for p in again.projections} == {tuple(p) for p in plain.projections}
    np.testing.assert_allclose(np.sort(again.share), np.sort(plain.share), atol=1e-5)


@pytest.mark.parametrize(("n", "span"), [(60, np.pi / 2), (60, 2 * np.pi), (2, 2 * np.pi)])
def test_nothing_is_closed_where_no_loop_is_or_steps_are_too_wide(
    crowd: Blobs, n: int, span: float
) -> None:
    theta = np.arange(n) * span / n
    assert len(LoopClosure().measure(seen(crowd, theta), theta, AXIS)) == 0


def test_empty_projections_close_no_loop() -> None:
    theta = np.arange(180) * np.pi / 90
    nothing = np.zeros((16, 180, COLUMNS), np.float32)
    assert len(LoopClosure().measure(nothing, theta, AXIS)) == 0
