from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import build
from tomoslam_stage.progress import heard_by
from tomoslam_stage.radon import Radon
from tomoslam_stage.reconstruction import ALGORITHMS, Algorithm, Fbp, Sirt
from tomoslam_stage.reconstruction.with_finufft import sirt_weights

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels

SIZE, AXIS = 64, 33.4
"""px: the detector, and an axis that lies off its middle and between two columns."""


@pytest.fixture(params=ALGORITHMS)
def algorithm(request: pytest.FixtureRequest) -> Algorithm:
    return build(ALGORITHMS, request.param, "algorithm")


@pytest.fixture
def theta() -> Floats:
    """(90,) radians, jittered by up to a third of a step and in no order."""
    rng = np.random.default_rng(7)
    return rng.permutation(np.arange(90) * np.pi / 90 + rng.uniform(-0.012, 0.012, 90))


@pytest.fixture
def sinograms(blobs: Blobs, theta: Floats) -> Pixels:
    """(3, 90, 64)"""
    return blobs.sinograms(theta, AXIS, SIZE)


def error(found: Pixels, truth: Pixels) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def left_over(slices: Pixels, sinograms: Pixels, theta: Floats) -> float:
    return float(np.linalg.norm(Radon(theta, AXIS, SIZE, SIZE).project(slices) - sinograms))


def test_every_algorithm_keeps_the_protocol(algorithm: Algorithm) -> None:
    assert isinstance(algorithm, Algorithm)


def test_every_algorithm_gives_values_in_units_of_attenuation_per_pixel(
    algorithm: Algorithm, blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    found = algorithm.slices(sinograms, theta, AXIS)
    assert found.shape == (3, SIZE, SIZE)
    assert found.dtype == np.float32
    assert error(found, blobs.slices(SIZE)) < 0.04


def test_every_algorithm_puts_z_first_and_the_axis_in_the_middle(
    algorithm: Algorithm, blobs: Blobs, theta: Floats
) -> None:
    found = algorithm.slices(blobs.sinograms(theta, 29.0, 63), theta, 29.0)
    assert np.unravel_index(found[0].argmax(), (63, 63)) == (31 - 4, 31 + 10)
    assert np.unravel_index(found[2].argmax(), (63, 63)) == (31 + 12, 31 + 13)


def test_every_algorithm_gives_the_same_image(sinograms: Pixels, theta: Floats) -> None:
    images = [make().slices(sinograms, theta, AXIS) for make in ALGORITHMS.values()]
    for image in images[1:]:
        assert error(image, images[0]) < 0.05


def test_every_algorithm_is_worse_off_with_a_wrong_axis(
    algorithm: Algorithm, blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    truth = blobs.slices(SIZE)
    right = error(algorithm.slices(sinograms, theta, AXIS), truth)
    for off in (-0.5, 0.5):
        assert error(algorithm.slices(sinograms, theta, AXIS + off), truth) > 2 * right


def test_every_algorithm_takes_any_number_of_rows_and_tells_of_its_progress(
    algorithm: Algorithm, sinograms: Pixels, theta: Floats
) -> None:
    told: list[tuple[str, int, int]] = []
    many = np.concatenate([sinograms, sinograms])[:5]
    with heard_by(lambda *news: told.append(news)):
        found = algorithm.slices(many, theta, AXIS)
    np.testing.assert_allclose(found[3:], found[:2], atol=1e-4)
    what = {"Fbp": "FBP", "Sirt": "SIRT"}[type(algorithm).__name__]
    assert told == [(what, 1, 2), (what, 2, 2)]


def truncated(theta: Floats, radius: float) -> Pixels:
    """(1, n, 64) of a disc of value one that reaches beyond the detector."""
    u = np.arange(SIZE) - (SIZE - 1) / 2
    chords = 2 * np.sqrt(radius**2 - u**2)
    return np.broadcast_to(chords, (1, len(theta), SIZE)).astype(np.float32)


def test_every_algorithm_bears_an_object_a_little_wider_than_the_detector(
    algorithm: Algorithm, theta: Floats
) -> None:
    found = algorithm.slices(truncated(theta, 35), theta, (SIZE - 1) / 2)[0]
    assert found[24:40, 24:40].mean() == pytest.approx(1, abs=0.1)
    assert np.abs(found).max() < 6


def test_sirt_does_not_blow_up_on_an_object_much_wider_than_the_detector(theta: Floats) -> None:
    sinograms = truncated(theta, 50)
    some, many = (
        Sirt(iterations=k, nonnegative=False).slices(sinograms, theta, (SIZE - 1) / 2)[0]
        for k in (50, 300)
    )
    # What is missing ends up in a bright rim; the middle is too high by a quarter, but it stays.
    assert many[24:40, 24:40].mean() == pytest.approx(some[24:40, 24:40].mean(), rel=0.02)
    assert np.abs(many).max() < 1.5 * np.abs(some).max()


@pytest.mark.parametrize("window", ["ram-lak", "shepp-logan", "hann"])
def test_fbp_filters_with_the_window_that_is_wanted(
    window: str, sinograms: Pixels, theta: Floats
) -> None:
    fbp = build(ALGORITHMS, {"method": "fbp", "window": window}, "algorithm")
    wanted = Radon(theta, AXIS, SIZE, SIZE).fbp(sinograms, window)  # type: ignore[arg-type]
    np.testing.assert_allclose(fbp.slices(sinograms, theta, AXIS), wanted, atol=1e-6)


def test_fbp_refuses_a_window_it_does_not_know() -> None:
    with pytest.raises(PipelineError, match=r"algorithm\.fbp\.window: 'hamming' does not fit"):
        build(ALGORITHMS, {"method": "fbp", "window": "hamming"}, "algorithm")


def test_sirt_leaves_ever_less_of_the_projections_and_nears_the_truth(
    blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    images = [Sirt(iterations=k).slices(sinograms, theta, AXIS) for k in (1, 5, 20, 80)]
    left = [left_over(image, sinograms, theta) for image in images]
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.02 * left[0]
    errors = [error(image, blobs.slices(SIZE)) for image in images]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.03


def test_sirt_gives_no_negative_attenuation_unless_it_may(sinograms: Pixels, theta: Floats) -> None:
    noisy = sinograms + np.random.default_rng(0).normal(0, 0.2, sinograms.shape).astype(np.float32)
    bound = Sirt(iterations=20).slices(noisy, theta, AXIS)
    free = Sirt(iterations=20, nonnegative=False).slices(noisy, theta, AXIS)
    assert bound.min() == 0
    assert free.min() < -0.01


def test_sirt_puts_nothing_where_not_every_projection_looks(
    sinograms: Pixels, theta: Floats
) -> None:
    found = Sirt(iterations=3, nonnegative=False).slices(sinograms, theta, AXIS)
    outside = ~Radon(theta, AXIS, SIZE, SIZE).disc()
    assert not found[:, outside].any()
    assert found[:, ~outside].any(axis=0).all()


def test_sirt_weighs_rays_by_their_path_and_pixels_by_the_rays_that_meet_them(
    theta: Floats,
) -> None:
    axis = (SIZE - 1) / 2
    weights = sirt_weights(Radon(theta, axis, SIZE, SIZE))
    u = np.arange(SIZE) - axis
    inside = np.abs(u) < 28
    path = 2 * np.sqrt(31**2 - u[inside] ** 2)
    np.testing.assert_allclose((weights.rays[:, inside] * path).mean(axis=0), 1, atol=0.02)
    assert not weights.rays[:, [0, -1]].any()
    middle = weights.pixels[24:40, 24:40]
    np.testing.assert_allclose(middle, 1 / len(theta), rtol=0.01)
    assert not weights.pixels[0].any()


def test_backends_do_not_import_finufft_before_it_is_needed() -> None:
    code = "import sys, tomoslam_stage.reconstruction; sys.exit('finufft' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_fbp_with_its_defaults_is_sharper_than_the_smoothest(
    sinograms: Pixels, theta: Floats
) -> None:
    default = Fbp().slices(sinograms, theta, AXIS)
    hann = Fbp(window="hann").slices(sinograms, theta, AXIS)
    assert default[2].max() > 1.02 * hann[2].max()
