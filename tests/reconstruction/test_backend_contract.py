"""What every backend must do with every algorithm that it has: the same image, the same way up."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, get_args

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tomoslam_stage.images import Window
from tomoslam_stage.reconstruction import (
    ALGORITHMS,
    BACKENDS,
    Algorithm,
    Backend,
    Fbp,
    Gridrec,
    Iterative,
    Sirt,
)

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels

CHOSEN: dict[str, Algorithm] = {
    "fbp": Fbp(window="ram-lak"),
    "gridrec": Gridrec(window="ram-lak"),
    "sirt": Sirt(iterations=60),
    "iterative": Iterative(name="mlem", iterations=60),
}
GEOMETRIES = pytest.mark.parametrize("detector", [(56, 26.3), (57, 31.65)], ids=["even", "odd"])
"""Columns, and an axis off their middle and between two of them."""
Detector: TypeAlias = tuple[int, float]
NEAR = 0.03
"""Relative error that passes for the same image."""


@dataclass(frozen=True)
class Discs:
    """Sharp discs in one slice."""

    x: Floats
    """(d,) px from the axis."""
    z: Floats
    """(d,) px from the axis."""
    radius: Floats
    """(d,) px."""
    height: Floats
    """(d,) attenuation per px."""

    def slices(self, size: int, fine: int = 8) -> Pixels:
        """(1, z, x) mean over each pixel."""
        along = (np.arange(size * fine) + 0.5) / fine - size / 2
        distance = np.hypot(along - self.x[:, None, None], along[:, None] - self.z[:, None, None])
        inside = distance <= self.radius[:, None, None]
        sharp = np.einsum("d,dzx->zx", self.height, inside.astype(np.float64))
        pixels = sharp.reshape(size, fine, size, fine).mean(axis=(1, 3))
        return pixels[None].astype(np.float32)

    def sinograms(self, theta: Floats, axis: float, columns: int, fine: int = 8) -> Pixels:
        """(1, n, column) mean of the chords over each column."""
        middle = np.outer(self.x, np.cos(theta)) + np.outer(self.z, np.sin(theta))
        along = (np.arange(columns * fine) + 0.5) / fine - 0.5 - axis
        off = along - middle[..., None]
        chords = 2 * np.sqrt(np.maximum(self.radius[:, None, None] ** 2 - off**2, 0))
        shadows = np.einsum("d,dnc->nc", self.height, chords)
        return shadows.reshape(1, len(theta), columns, fine).mean(axis=-1).astype(np.float32)


@pytest.fixture(scope="module")
def discs() -> Discs:
    """A body with a hole and two grains, without any symmetry."""
    return Discs(
        x=np.array([1.0, -7.0, 9.0, 2.0]),
        z=np.array([-2.0, -8.0, 4.0, 9.0]),
        radius=np.array([18.0, 4.0, 5.0, 3.0]),
        height=np.array([0.4, -0.4, 0.3, 0.5]),
    )


@pytest.fixture(scope="module")
def soft(blobs: Blobs) -> Blobs:
    """What even few iterations resolve."""
    return replace(blobs, width=blobs.width + 1.5)


@pytest.fixture
def theta() -> Floats:
    """(120,) radians, jittered by up to a third of a step, in no order, from beyond the turn on."""
    rng = np.random.default_rng(7)
    jitter = rng.uniform(-0.009, 0.009, 120)
    return rng.permutation(7.0 + np.arange(120) * np.pi / 120 + jitter)


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    return BACKENDS[request.param]


@pytest.fixture(params=ALGORITHMS)
def algorithm(request: pytest.FixtureRequest) -> Algorithm:
    return CHOSEN[request.param]


def slices_of(
    backend: Backend, algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float
) -> Pixels:
    """Reconstruct, or skip with the reason the backend has."""
    why = backend.refusal(algorithm)
    if why:
        pytest.skip(f"{backend.name} {why}")
    return backend.reconstruct(algorithm, sinograms, theta, axis).slices


def inside(size: int, radius: float) -> Pixels:
    along = np.arange(size) - (size - 1) / 2
    return (np.hypot(along[:, None], along) <= radius).astype(np.float32)


def error(found: Pixels, truth: Pixels) -> float:
    seen = inside(truth.shape[-1], 22)
    return float(np.linalg.norm((found - truth) * seen) / np.linalg.norm(truth * seen))


@GEOMETRIES
def test_soft_blobs_come_out_where_and_as_they_are(
    backend: Backend, algorithm: Algorithm, soft: Blobs, theta: Floats, detector: Detector
) -> None:
    columns, axis = detector
    found = slices_of(backend, algorithm, soft.sinograms(theta, axis, columns), theta, axis)
    truth = soft.slices(columns)
    assert found.shape == truth.shape
    assert found.dtype == np.float32
    assert error(found, truth) < NEAR


@GEOMETRIES
def test_sharp_discs_come_out_where_and_as_they_are(
    backend: Backend, algorithm: Algorithm, discs: Discs, theta: Floats, detector: Detector
) -> None:
    columns, axis = detector
    found = slices_of(backend, algorithm, discs.sinograms(theta, axis, columns), theta, axis)
    soft = [gaussian_filter(image, (0, 1.5, 1.5)) for image in (found, discs.slices(columns))]
    assert error(*soft) < NEAR


@GEOMETRIES
@pytest.mark.parametrize("window", get_args(Window))
@pytest.mark.parametrize("other", [Fbp, Gridrec])
def test_backends_blur_sharp_edges_alike_with_the_same_window(
    other: type[Fbp | Gridrec],
    window: Window,
    discs: Discs,
    theta: Floats,
    detector: Detector,
) -> None:
    columns, axis = detector
    sinograms = discs.sinograms(theta, axis, columns)
    found = slices_of(BACKENDS["tomopy"], other(window=window), sinograms, theta, axis)
    embedded = BACKENDS["embedded"].reconstruct(Fbp(window=window), sinograms, theta, axis)
    assert error(found, embedded.slices) < NEAR


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_a_slice_does_not_depend_on_what_else_is_reconstructed(
    backend: Backend, algorithm: Algorithm, blobs: Blobs, theta: Floats, rows: int
) -> None:
    sinograms = np.resize(blobs.sinograms(theta, 26.3, 56), (rows, 120, 56))
    if isinstance(algorithm, Sirt):
        algorithm = Sirt(iterations=2)
    together = slices_of(backend, algorithm, sinograms, theta, 26.3)
    alone = slices_of(backend, algorithm, sinograms[-1:], theta, 26.3)
    np.testing.assert_allclose(together[-1:], alone, atol=1e-5 * np.abs(alone).max())


def test_slices_do_not_depend_on_the_number_of_workers(
    backend: Backend,
    algorithm: Algorithm,
    blobs: Blobs,
    theta: Floats,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sinograms = np.concatenate([blobs.sinograms(theta, 26.3, 56)] * 3)
    if isinstance(algorithm, Sirt):
        algorithm = Sirt(iterations=2)
    made = []
    for cores in (1, 3):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        made.append(slices_of(backend, algorithm, sinograms, theta, 26.3))
    np.testing.assert_array_equal(made[0], made[1])


def test_an_object_wider_than_the_detector_keeps_its_values_in_the_middle(
    backend: Backend, algorithm: Algorithm, theta: Floats
) -> None:
    wide = Discs(
        x=np.array([0.0, 5.0]),
        z=np.array([0.0, -6.0]),
        radius=np.array([26.0, 4.0]),
        height=np.array([0.5, 0.5]),
    )
    columns, axis = 40, 19.7
    found = slices_of(backend, algorithm, wide.sinograms(theta, axis, columns), theta, axis)
    truth = wide.slices(columns)
    off = gaussian_filter(found, (0, 1.5, 1.5)) - gaussian_filter(truth, (0, 1.5, 1.5))
    assert np.sqrt(np.mean(off[0][inside(columns, 15) > 0] ** 2)) < 0.05 * 0.5
