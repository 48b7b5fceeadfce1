from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.radon import Radon, continued, object_reach, reach_beyond
from tomoslam_stage.reconstruction import Algorithm, Fbp, Sirt
from tomoslam_stage.reconstruction.with_finufft import Embedded

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels

SIZE = 64
MIDDLE = (SIZE - 1) / 2
THETA = np.arange(100) * np.pi / 100
ATTENUATION = 0.02
"""Of the body, per px; the inclusions add some of their own."""


@dataclass(frozen=True)
class Ellipse:
    """One of constant attenuation whose axes lie along x and z."""

    x: float
    z: float
    half: tuple[float, float]
    """px along x and along z."""
    value: float = ATTENUATION

    def sinogram(self, axis: float, columns: int = SIZE) -> Floats:
        """(n, column)"""
        (a, b), cosine, sine = self.half, np.cos(THETA)[:, None], np.sin(THETA)[:, None]
        squared = (a * cosine) ** 2 + (b * sine) ** 2
        off = np.arange(columns) - axis - (self.x * cosine + self.z * sine)
        chords = 2 * a * b * np.sqrt(np.maximum(squared - off**2, 0)) / squared
        return np.asarray(self.value * chords)

    def slice(self) -> Floats:
        """(z, x)"""
        along = np.arange(SIZE) - MIDDLE
        a, b = self.half
        return self.value * (((along - self.x) / a) ** 2 + ((along[:, None] - self.z) / b) ** 2 < 1)


INCLUSIONS = (Ellipse(7, -9, (5, 4)), Ellipse(-12, 10, (7, 4), -0.5 * ATTENUATION))
BODIES = {
    "a little wider": Ellipse(0, 0, (34, 31)),
    "wider": Ellipse(0, 0, (43, 37)),
    "twice as wide": Ellipse(5, 3, (70, 60)),
    "off to one side": Ellipse(11, 3, (27, 23)),
}
SEEN_WHOLE = Ellipse(0, 0, (29, 27))


def sinograms(body: Ellipse, axis: float = MIDDLE, columns: int = SIZE) -> Pixels:
    """(1, n, column)"""
    parts = [part.sinogram(axis, columns) for part in (body, *INCLUSIONS)]
    return np.sum(parts, axis=0)[None].astype(np.float32)


def errors(found: Pixels, body: Ellipse) -> tuple[float, float]:
    """Rms error over the field of view and the mean one near its rim, in units of the body."""
    truth = np.sum([part.slice() for part in (body, *INCLUSIONS)], axis=0)
    along = np.arange(SIZE) - MIDDLE
    radius = np.hypot(along[:, None], along)
    error = (found - truth) / ATTENUATION
    rim = (radius > 26) & (radius < 31)
    return float(np.sqrt(np.mean(error[radius < 31] ** 2))), float(error[rim].mean())


def solved(algorithm: Algorithm, sinograms: Pixels, axis: float = MIDDLE) -> Pixels:
    """(z, x)"""
    return Embedded().reconstruct(algorithm, sinograms, THETA, axis).slices[0]


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("which", [Fbp(), Sirt(iterations=60)], ids=["fbp", "sirt"])
def test_an_object_wider_than_the_detector_keeps_its_values_in_the_field_of_view(
    which: Algorithm, body: Ellipse
) -> None:
    rms, rim = errors(solved(which, sinograms(body)), body)
    assert rms < 0.09
    assert abs(rim) < 0.09


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_continued_projections_make_a_better_image_than_tapered_ones(body: Ellipse) -> None:
    wide = sinograms(body, MIDDLE + SIZE, 3 * SIZE)
    whole = Radon(THETA, MIDDLE + SIZE, 3 * SIZE, SIZE).fbp(wide, "shepp-logan")[0]
    recorded = sinograms(body)
    tapered = Radon(THETA, MIDDLE, SIZE, SIZE).fbp(recorded, "shepp-logan")[0]
    inside = Radon(THETA, MIDDLE, SIZE, SIZE).disc()
    after, before = (
        np.linalg.norm((found - whole)[inside]) for found in (solved(Fbp(), recorded), tapered)
    )
    assert after < 0.4 * before


@pytest.mark.parametrize("axis", [24.0, 39.2])
@pytest.mark.parametrize("which", [Fbp(), Sirt(iterations=60)], ids=["fbp", "sirt"])
def test_an_axis_off_the_middle_is_no_obstacle(which: Algorithm, axis: float) -> None:
    body = BODIES["wider"]
    rms, rim = errors(solved(which, sinograms(body, axis), axis), body)
    assert rms < 0.12
    assert abs(rim) < 0.09


def test_sirt_stays_where_it_is_with_many_iterations() -> None:
    recorded = sinograms(BODIES["twice as wide"])
    some, many = (solved(Sirt(iterations=k, nonnegative=False), recorded) for k in (50, 300))
    assert many[24:40, 24:40].mean() == pytest.approx(some[24:40, 24:40].mean(), rel=0.02)
    assert np.abs(many).max() < 1.2 * np.abs(some).max()


def test_convergence_tells_of_the_columns_that_were_recorded() -> None:
    recorded = sinograms(BODIES["wider"])
    found = Embedded().reconstruct(Sirt(iterations=30), recorded, THETA, MIDDLE).convergence
    assert found[0] == pytest.approx(np.sqrt(np.mean(recorded**2)), rel=1e-5)
    assert (np.diff(found) < 0).all()
    assert found[-1] < 0.1 * found[0]


def test_nothing_is_added_to_an_object_that_is_seen_whole() -> None:
    recorded = sinograms(SEEN_WHOLE)
    noise = np.random.default_rng(0).normal(0, 0.1, recorded.shape).astype(np.float32)
    assert recorded.max() < 1.5, "the noise is not small"
    for shown in (recorded, recorded + noise, np.zeros_like(recorded), recorded + 0.01):
        assert reach_beyond(shown) == 0
    assert continued(recorded, 0) is recorded
    wanted = Radon(THETA, MIDDLE, SIZE, SIZE).fbp(recorded, "shepp-logan")
    np.testing.assert_array_equal(solved(Fbp(), recorded), wanted[0])


@pytest.mark.parametrize("half", [36, 44, 56])
def test_a_disc_goes_on_for_as_far_as_it_does(half: float) -> None:
    disc = Ellipse(0, 0, (half, half))
    recorded = disc.sinogram(MIDDLE)[None].astype(np.float32)
    by = reach_beyond(recorded)
    assert by == pytest.approx(half - MIDDLE, abs=2)
    wide = disc.sinogram(MIDDLE + by, SIZE + 2 * by)
    np.testing.assert_allclose(continued(recorded, by)[0], wide, atol=0.08 * wide.max())
    np.testing.assert_array_equal(continued(recorded, by)[..., by:-by], recorded)


def test_either_end_goes_on_by_itself() -> None:
    aside = Ellipse(20, 0, (20, 20)).sinogram(MIDDLE)[None, :1].astype(np.float32)
    wide = continued(aside, 12)
    assert not wide[..., :12].any()
    added = wide[0, 0, -12:]
    assert added[0] > 0.5 * aside[0, 0, -1]
    assert (np.diff(added) <= 0).all()
    np.testing.assert_array_equal(continued(aside[..., ::-1], 12), wide[..., ::-1])


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0])
def test_what_is_added_ends_within_reach_even_where_there_is_no_bend(level: float) -> None:
    flat = np.full((2, 3, SIZE), level, np.float32)
    reach = reach_beyond(flat)
    assert reach == (47 if level > 0 else 0)
    added = continued(flat, 48)[..., -48:]
    assert np.isfinite(added).all()
    np.testing.assert_allclose(added[..., [0, -1]], [[[max(level, 0), 0]] * 3] * 2, atol=1e-3)


def test_the_object_reaches_from_the_axis_to_its_farthest_shadow() -> None:
    recorded = Ellipse(0, 0, (20, 20)).sinogram(MIDDLE)[None].astype(np.float32)
    assert object_reach(recorded, MIDDLE, 0) == pytest.approx(20, abs=0.6)
    assert object_reach(recorded, MIDDLE - 15, 0) == pytest.approx(35, abs=0.6)
    assert object_reach(recorded, MIDDLE, 6) == MIDDLE + 6
    assert object_reach(0 * recorded, MIDDLE, 0) == 0


def test_sirt_has_room_for_what_lies_farther_from_the_axis_than_half_the_detector() -> None:
    # Over half a turn an object beside the axis may pass the whole detector and never leave it.
    body = Ellipse(-4, 20, (8, 17))
    recorded = body.sinogram(20.0)[None].astype(np.float32)
    assert reach_beyond(recorded) == 0
    found = solved(Sirt(iterations=60), recorded, 20.0)
    inside = body.slice()[5:-5] > 0
    assert np.abs(found[5:-5][inside] / ATTENUATION - 1).mean() < 0.08
    assert found.max() < 1.5 * ATTENUATION
