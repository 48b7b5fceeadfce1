from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import build
from tomoslam_stage.parallel import BLOCK
from tomoslam_stage.progress import heard_by
from tomoslam_stage.radon import Radon
from tomoslam_stage.reconstruction import ALGORITHMS, Algorithm, Backend, Fbp, Gridrec, Sirt
from tomoslam_stage.reconstruction.with_finufft import Embedded, sirt_weights

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels
    from tomoslam_stage.reconstruction import Slices

SIZE, AXIS = 64, 33.4
"""px: the detector, and an axis that lies off its middle and between two columns."""


EMBEDDED: Backend = Embedded()
"""Its type has mypy check that it keeps the protocol."""


@pytest.fixture(params=["fbp", "sirt"])
def algorithm(request: pytest.FixtureRequest) -> Algorithm:
    return build(ALGORITHMS, request.param, "algorithm")


def solved(algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float = AXIS) -> Pixels:
    """(r, z, x)"""
    return EMBEDDED.reconstruct(algorithm, sinograms, theta, axis).slices


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


def test_gridrec_is_refused_and_the_others_are_not(algorithm: Algorithm) -> None:
    assert EMBEDDED.refusal(Gridrec()) == "has no gridrec"
    assert EMBEDDED.refusal(algorithm) == ""
    with pytest.raises(ValueError, match="embedded has no gridrec"):
        EMBEDDED.reconstruct(Gridrec(), np.ones((1, 2, 8), np.float32), np.arange(2.0), 3.5)


def test_every_algorithm_gives_values_in_units_of_attenuation_per_pixel(
    algorithm: Algorithm, blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    found = solved(algorithm, sinograms, theta, AXIS)
    assert found.shape == (3, SIZE, SIZE)
    assert found.dtype == np.float32
    assert error(found, blobs.slices(SIZE)) < 0.04


def test_every_algorithm_puts_z_first_and_the_axis_in_the_middle(
    algorithm: Algorithm, blobs: Blobs, theta: Floats
) -> None:
    found = solved(algorithm, blobs.sinograms(theta, 29.0, 63), theta, 29.0)
    assert np.unravel_index(found[0].argmax(), (63, 63)) == (31 - 4, 31 + 10)
    assert np.unravel_index(found[2].argmax(), (63, 63)) == (31 + 12, 31 + 13)


def test_fbp_and_sirt_give_the_same_image(sinograms: Pixels, theta: Floats) -> None:
    images = [solved(make(), sinograms, theta, AXIS) for make in (Fbp, Sirt)]
    for image in images[1:]:
        assert error(image, images[0]) < 0.05


def test_every_algorithm_is_worse_off_with_a_wrong_axis(
    algorithm: Algorithm, blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    truth = blobs.slices(SIZE)
    right = error(solved(algorithm, sinograms, theta, AXIS), truth)
    for off in (-0.5, 0.5):
        assert error(solved(algorithm, sinograms, theta, AXIS + off), truth) > 2 * right


def test_every_algorithm_takes_any_number_of_rows_and_tells_of_its_progress(
    algorithm: Algorithm, sinograms: Pixels, theta: Floats
) -> None:
    told: list[tuple[str, int, int]] = []
    many = np.concatenate([sinograms, sinograms])[:5]
    with heard_by(lambda *news: told.append(news)):
        found = solved(algorithm, many, theta, AXIS)
    np.testing.assert_allclose(found[3:], found[:2], atol=1e-4)
    what = {"Fbp": "FBP", "Sirt": "SIRT"}[type(algorithm).__name__]
    assert told == [(what, 1, 2), (what, 2, 2)]


@pytest.mark.parametrize("window", ["ram-lak", "shepp-logan", "hann"])
def test_fbp_filters_with_the_window_that_is_wanted(
    window: str, sinograms: Pixels, theta: Floats
) -> None:
    fbp = build(ALGORITHMS, {"method": "fbp", "window": window}, "algorithm")
    wanted = Radon(theta, AXIS, SIZE, SIZE).fbp(sinograms, window)  # type: ignore[arg-type]
    np.testing.assert_allclose(solved(fbp, sinograms, theta, AXIS), wanted, atol=1e-6)


def test_fbp_refuses_a_window_it_does_not_know() -> None:
    with pytest.raises(PipelineError, match=r"algorithm\.fbp\.window: 'boxcar' does not fit"):
        build(ALGORITHMS, {"method": "fbp", "window": "boxcar"}, "algorithm")


def test_sirt_leaves_ever_less_of_the_projections_and_nears_the_truth(
    blobs: Blobs, sinograms: Pixels, theta: Floats
) -> None:
    images = [solved(Sirt(iterations=k), sinograms, theta, AXIS) for k in (1, 5, 20, 80)]
    left = [left_over(image, sinograms, theta) for image in images]
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.02 * left[0]
    errors = [error(image, blobs.slices(SIZE)) for image in images]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.03


def test_sirt_gives_no_negative_attenuation_unless_it_may(sinograms: Pixels, theta: Floats) -> None:
    noisy = sinograms + np.random.default_rng(0).normal(0, 0.2, sinograms.shape).astype(np.float32)
    bound = solved(Sirt(iterations=20), noisy, theta, AXIS)
    free = solved(Sirt(iterations=20, nonnegative=False), noisy, theta, AXIS)
    assert bound.min() == 0
    assert free.min() < -0.01


def test_sirt_puts_nothing_where_not_every_projection_looks(
    sinograms: Pixels, theta: Floats
) -> None:
    found = solved(Sirt(iterations=3, nonnegative=False), sinograms, theta, AXIS)
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
    default = solved(Fbp(), sinograms, theta, AXIS)
    hann = solved(Fbp(window="hann"), sinograms, theta, AXIS)
    assert default[2].max() > 1.02 * hann[2].max()


def test_stronger_windows_make_smoother_slices(sinograms: Pixels, theta: Floats) -> None:
    noisy = sinograms + np.random.default_rng(1).normal(0, 0.1, sinograms.shape).astype(np.float32)

    def roughness(fbp: Fbp) -> float:
        return float(np.abs(np.diff(solved(fbp, noisy, theta))).mean())

    rough, fair, smooth = map(
        roughness, (Fbp(window="ram-lak"), Fbp(window="shepp-logan"), Fbp(window="hann"))
    )
    assert rough > 1.1 * fair > 1.3 * smooth


def test_convergence_is_the_rms_of_what_is_left_before_each_iteration(
    sinograms: Pixels, theta: Floats
) -> None:
    many = np.concatenate([sinograms, sinograms])[:5]
    convergence = EMBEDDED.reconstruct(Sirt(iterations=30), many, theta, AXIS).convergence
    assert convergence.shape == (30,)
    assert (np.diff(convergence) < 0).all()
    assert convergence[0] == pytest.approx(np.sqrt(np.mean(many**2)), rel=1e-6)
    after_7 = Radon(theta, AXIS, SIZE, SIZE).project(solved(Sirt(iterations=7), many, theta))
    assert convergence[7] == pytest.approx(np.sqrt(np.mean((many - after_7) ** 2)), rel=1e-3)


def test_nothing_converges_in_fbp(sinograms: Pixels, theta: Floats) -> None:
    assert EMBEDDED.reconstruct(Fbp(), sinograms, theta, AXIS).convergence.size == 0


@pytest.mark.parametrize("which", [Fbp(), Sirt(iterations=5)], ids=["fbp", "sirt"])
@pytest.mark.parametrize("columns", [SIZE, 40], ids=["seen whole", "wider than the detector"])
def test_results_are_the_same_to_the_bit_for_any_number_of_workers(
    which: Algorithm, columns: int, blobs: Blobs, theta: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = (columns - 1) / 2
    some = blobs.sinograms(theta, axis, columns) + (columns == 40) * np.float32(3)
    many = np.concatenate([some, some[::-1], 0.3 * some, some])[:10]

    def on(cores: int) -> Slices:
        monkeypatch.setattr(os, "cpu_count", lambda: cores)
        return EMBEDDED.reconstruct(which, many, theta, axis)

    alone, together = on(1), on(5)
    np.testing.assert_array_equal(together.slices, alone.slices)
    np.testing.assert_array_equal(together.convergence, alone.convergence)


@pytest.mark.parametrize("which", [Fbp(), Sirt(iterations=2)], ids=["fbp", "sirt"])
def test_only_a_block_of_rows_is_ever_transformed_at_once(
    which: Algorithm, sinograms: Pixels, theta: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []
    plan = Radon._plan

    def noted(radon: Radon, kind: int, count: int) -> object:
        counts.append(count)
        return plan(radon, kind, count)

    monkeypatch.setattr(Radon, "_plan", noted)
    found = solved(which, np.concatenate(3 * [sinograms]), theta)
    assert found.shape == (9, SIZE, SIZE)
    assert max(counts) == BLOCK
