from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage import geometry as angles
from tomoslam_stage import radon
from tomoslam_stage.radon import Radon

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels

GEOMETRIES = pytest.mark.parametrize(
    ("size", "columns", "axis"),
    [(64, 64, 31.5), (65, 65, 32.0), (64, 81, 43.3), (63, 48, 20.8), (64, 64, 4.25)],
    ids=["even", "odd", "wide, axis off", "narrow, axis off", "axis at the edge"],
)
"""In the last two the object is not seen whole."""


@pytest.fixture
def irregular() -> Floats:
    """(41,) radians: neither sorted nor equal, over more than a turn."""
    return np.random.default_rng(3).uniform(-1, 7, 41)


def half_turn(n: int) -> Floats:
    return np.arange(n) * np.pi / n


def disc_sinogram(radius: float, n: int, columns: int) -> Pixels:
    """(1, n, column) of a disc of value one about the middle."""
    u = np.arange(columns) - (columns - 1) / 2
    chord = 2 * np.sqrt(np.maximum(radius**2 - u**2, 0))
    return np.broadcast_to(chord, (1, n, columns)).astype(np.float32)


def ring_means(image: Pixels, edges: list[float]) -> Floats:
    along = np.arange(len(image)) - (len(image) - 1) / 2
    distance = np.hypot(along[:, None], along)
    rings = pairwise(edges)
    return np.array([image[(distance >= a) & (distance < b)].mean() for a, b in rings])


def relative(found: Pixels, wanted: Pixels) -> float:
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


@GEOMETRIES
def test_projections_of_blobs_are_those_of_the_closed_form(
    blobs: Blobs, irregular: Floats, size: int, columns: int, axis: float
) -> None:
    found = Radon(irregular, axis, columns, size).project(blobs.slices(size))
    assert found.shape == (3, 41, columns)
    assert found.dtype == np.float32
    assert relative(found, blobs.sinograms(irregular, axis, columns)) < 2e-5


@GEOMETRIES
def test_the_derivative_is_that_of_the_closed_form(
    blobs: Blobs, irregular: Floats, size: int, columns: int, axis: float
) -> None:
    found = Radon(irregular, axis, columns, size).derivative(blobs.slices(size))
    assert found.dtype == np.float32
    assert relative(found, blobs.derivative(irregular, axis, columns)) < 2e-4


@GEOMETRIES
def test_linearised_projections_agree_with_the_closed_form(
    blobs: Blobs, irregular: Floats, size: int, columns: int, axis: float
) -> None:
    radon = Radon(irregular, axis, columns, size)
    found, by_angle, by_axis = radon.linearised(blobs.slices(size))
    assert relative(found, blobs.sinograms(irregular, axis, columns)) < 2e-4
    assert relative(by_angle, blobs.derivative(irregular, axis, columns)) < 5e-3
    further, nearer = (blobs.sinograms(irregular, axis + off, columns) for off in (0.05, -0.05))
    assert relative(by_axis, (further - nearer) / 0.1) < 2e-3
    assert {found.dtype, by_angle.dtype, by_axis.dtype} == {np.dtype(np.float32)}


@GEOMETRIES
def test_the_adjoint_is_the_transpose_of_the_projector(
    irregular: Floats, size: int, columns: int, axis: float
) -> None:
    rng = np.random.default_rng(8)
    geometry = Radon(irregular, axis, columns, size)
    slices = rng.normal(size=(2, size, size)).astype(np.float32)
    sinograms = rng.normal(size=(2, 41, columns)).astype(np.float32)
    forward, backward = geometry.project(slices), geometry.adjoint(sinograms)
    assert backward.shape == slices.shape
    difference = np.vdot(forward, sinograms) - np.vdot(slices, backward)
    assert abs(difference) < 1e-5 * np.linalg.norm(forward) * np.linalg.norm(sinograms)


def test_the_adjoint_spreads_a_lone_ray_along_its_own_line() -> None:
    sinogram = np.zeros((1, 1, 33), np.float32)
    sinogram[0, 0, 21] = 1
    upright = Radon(np.array([0.0]), 16.0, 33, 33).adjoint(sinogram)[0]
    flat = Radon(np.array([np.pi / 2]), 16.0, 33, 33).adjoint(sinogram)[0]
    lone = np.zeros((33, 33))
    lone[:, 21] = 1
    np.testing.assert_allclose(upright, lone, atol=1e-4)
    np.testing.assert_allclose(flat, lone.T, atol=1e-4)


@pytest.mark.parametrize("axis", [31.5, 35.2])
@pytest.mark.parametrize("turns", [0.5, 1.0, 1.5])
def test_fbp_without_a_window_gives_blobs_back(blobs: Blobs, turns: float, axis: float) -> None:
    theta = half_turn(round(180 * turns)) * 2 * turns
    sinograms = blobs.sinograms(theta, axis, 64)
    found = Radon(theta, axis, 64, 64).fbp(sinograms, "ram-lak")
    assert found.shape == (3, 64, 64)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, blobs.slices(64), atol=2e-4)


@pytest.mark.parametrize("size", [48, 49])
def test_a_slice_may_be_larger_or_smaller_than_the_detector(blobs: Blobs, size: int) -> None:
    theta = half_turn(120)
    for columns in (56, 80):
        axis = (columns - 1) / 2 + 0.3
        geometry = Radon(theta, axis, columns, size)
        found = geometry.fbp(blobs.sinograms(theta, axis, columns), "ram-lak")
        np.testing.assert_allclose(found, blobs.slices(size), atol=0.01)


def test_z_is_the_first_index_of_a_slice_and_grows_with_the_column_at_a_quarter_turn(
    blobs: Blobs,
) -> None:
    theta = half_turn(90)
    found = Radon(theta, 31.0, 63, 63).fbp(blobs.sinograms(theta, 31.0, 63))
    assert np.unravel_index(found[0].argmax(), (63, 63)) == (31 - 4, 31 + 10)
    assert np.unravel_index(found[1].argmax(), (63, 63)) == (31 + 9, 31 - 7)
    assert np.unravel_index(found[2].argmax(), (63, 63)) == (31 + 12, 31 + 13)


def test_stronger_windows_blur_more_and_hann_is_the_default(blobs: Blobs) -> None:
    theta = half_turn(120)
    geometry, sinograms = Radon(theta, 31.0, 63, 63), blobs.sinograms(theta, 31.0, 63)
    sharp, fair, soft = (
        geometry.fbp(sinograms, window)[2].max() for window in ("ram-lak", "shepp-logan", "hann")
    )
    assert sharp == pytest.approx(1.2, rel=1e-3)
    assert sharp > 1.01 * fair > 1.02 * soft
    np.testing.assert_array_equal(geometry.fbp(sinograms), geometry.fbp(sinograms, "hann"))


@pytest.mark.parametrize("window", ["ram-lak", "shepp-logan", "hann"])
def test_a_flat_disc_has_its_value_everywhere_inside_and_none_outside(
    window: radon.Window,
) -> None:
    sinogram = disc_sinogram(30, 180, 96)
    found = Radon(half_turn(180), 47.5, 96, 96).fbp(sinogram, window)[0]
    np.testing.assert_allclose(ring_means(found, [0, 7, 14, 21, 28]), 1, atol=0.004)
    np.testing.assert_allclose(ring_means(found, [33, 38, 43, 47]), 0, atol=0.004)


def test_a_disc_that_reaches_beyond_the_detector_keeps_its_value_inside() -> None:
    sinogram = disc_sinogram(80, 180, 96)
    found = Radon(half_turn(180), 47.5, 96, 96).fbp(sinogram)[0]
    np.testing.assert_allclose(ring_means(found, [0, 10, 20, 30, 40, 46]), 1, atol=0.05)


def test_weights_for_unequal_steps_make_jittered_angles_reconstruct_better(
    dots: Blobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    theta = half_turn(120) + np.random.default_rng(1).uniform(-0.012, 0.012, 120)
    geometry, truth = Radon(theta, 47.5, 96, 96), dots.slices(96)
    sinograms = dots.sinograms(theta, 47.5, 96)
    weighted = np.linalg.norm(geometry.fbp(sinograms, "ram-lak") - truth)
    monkeypatch.setattr(radon, "angular_weights", lambda theta: np.full(len(theta), np.pi / 120))
    equal = np.linalg.norm(geometry.fbp(sinograms, "ram-lak") - truth)
    assert weighted < 0.8 * equal


@pytest.mark.parametrize(("noise", "times"), [(0.0, 1.02), (0.05, 0.8)])
def test_the_projections_beside_a_missing_wedge_do_not_fill_the_image_with_their_noise(
    dots: Blobs, monkeypatch: pytest.MonkeyPatch, noise: float, times: float
) -> None:
    theta = np.deg2rad(np.arange(121.0))
    geometry, truth = Radon(theta, 47.5, 96, 96), dots.slices(96)
    sinograms = dots.sinograms(theta, 47.5, 96)
    sinograms += np.random.default_rng(5).normal(0, noise, sinograms.shape).astype(np.float32)
    limited = np.linalg.norm(geometry.fbp(sinograms) - truth)
    monkeypatch.setattr(angles, "WIDEST_GAP", np.inf)
    whole = np.linalg.norm(geometry.fbp(sinograms) - truth)
    assert limited < times * whole


def test_slices_do_not_depend_on_what_is_reconstructed_with_them(blobs: Blobs) -> None:
    theta = half_turn(60)
    geometry, sinograms = Radon(theta, 31.5, 64, 64), blobs.sinograms(theta, 31.5, 64)
    together = geometry.fbp(sinograms)
    alone = np.concatenate([geometry.fbp(row[None]) for row in sinograms])
    np.testing.assert_allclose(together, alone, atol=1e-6)


@pytest.mark.parametrize("size", [8, 9, 64])
def test_the_disc_is_what_a_centred_detector_sees_at_every_angle(size: int) -> None:
    inside = Radon(np.zeros(1), (size - 1) / 2, size, size).disc()
    z, x = np.nonzero(inside) - np.array((size - 1) / 2)
    for angle in np.linspace(0, np.pi, 50):
        assert np.abs(x * np.cos(angle) + z * np.sin(angle)).max() <= (size - 1) / 2
    np.testing.assert_array_equal(inside, inside[::-1, ::-1].T)
    middle = inside[size // 2]
    assert middle.sum() >= size - 3
    assert not middle[0]
    assert not middle[-1]
