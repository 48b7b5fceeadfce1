from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.mapping.maps import around_objects, contrast, denoised, mapped, seen, standing
from tomoslam_stage.radon import Radon

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Floats, Pixels


def total_variation(image: Pixels) -> float:
    down, right = np.diff(image, axis=0)[:, :-1], np.diff(image, axis=1)[:-1]
    return float(np.hypot(down, right).sum())


@pytest.fixture
def step() -> Floats:
    """(1, z, x) a block of height one."""
    image = np.zeros((1, 24, 24))
    image[0, 8:16, 6:20] = 1
    return image


def test_denoising_takes_off_noise_and_leaves_edges(step: Floats) -> None:
    noisy = (step + np.random.default_rng(1).normal(0, 0.1, step.shape)).astype(np.float32)
    clean = denoised(noisy, np.array([0.2], np.float32))
    assert np.std(clean - step) < 0.6 * np.std(noisy - step)
    assert clean[0, 12, 8:18].mean() > 0.85


def test_denoising_lowers_what_it_says_it_lowers(step: Floats) -> None:
    noisy = (step + np.random.default_rng(1).normal(0, 0.1, step.shape)).astype(np.float32)
    weight = 0.2

    def cost(image: Pixels) -> float:
        return float(((image - noisy) ** 2).sum() / 2 + weight * total_variation(image[0]))

    best = denoised(noisy, np.array([weight], np.float32))
    rng = np.random.default_rng(2)
    others = [best + rng.normal(0, 0.02, best.shape) for _ in range(5)]
    assert cost(best) < min(map(cost, [noisy, step.astype(np.float32), *others]))


def test_slices_of_no_weight_stay_as_they_are(step: Floats) -> None:
    both = np.concatenate([step, step]).astype(np.float32)
    found = denoised(both, np.array([0, 0.1], np.float32))
    assert np.array_equal(found[0], both[0])
    assert not np.array_equal(found[1], both[1])


def test_what_all_projections_have_at_one_place_is_the_detectors() -> None:
    rng = np.random.default_rng(3)
    turns, stays = rng.normal(size=(2, 6, 9)), rng.normal(size=(2, 1, 9))
    turns -= turns.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(standing((turns + stays).astype(np.float32)), stays, atol=1e-6)


def test_air_is_told_from_objects_and_thin_layers_keep_a_rim() -> None:
    slices = np.random.default_rng(4).normal(0, 0.02, (2, 48, 48)).astype(np.float32)
    slices[0, 20:23, 10:38] += 1
    slices[1, 10:38, 24:28] += 3
    inside = np.ones((48, 48), bool)
    inside[:, -12:] = False
    kept = around_objects(slices, inside, 0.2)
    assert kept[0, 17:26, 12:34].all()
    assert not kept[0, :12].any()
    assert not kept[:, :, -12:].any()
    # Densest or not, each slice has air of its own.
    assert kept[1].mean() < 0.3


def test_an_empty_slice_has_no_contrast() -> None:
    slices = np.zeros((2, 4, 4), np.float32)
    slices[1, 0] = [1, 3, 1, 3]
    np.testing.assert_allclose(contrast(slices), [0, 1])


def test_what_is_seen_is_what_the_window_of_hann_lets_through() -> None:
    wave = np.cos(2 * np.pi * np.arange(64) / 8).astype(np.float32)[None, None]
    share = 0.5 + 0.5 * np.cos(2 * np.pi / 8)
    np.testing.assert_allclose(seen(wave)[..., 1:-1], share * wave[..., 1:-1], atol=1e-6)


def test_a_map_explains_the_sinograms_it_was_made_of(dots: Blobs) -> None:
    theta = np.arange(120) * np.pi / 120
    sinograms = dots.sinograms(theta, 40.0, 81)
    radon = Radon(theta, 40.0, 81, 81)
    slices = mapped(sinograms, radon, 0.0)
    assert slices.min() >= 0
    left = seen(sinograms) - radon.project(slices)
    assert np.std(left) < 0.03 * np.std(sinograms)


def test_a_map_with_its_air_made_empty_explains_them_too_and_has_either_sign(dots: Blobs) -> None:
    theta = np.arange(120) * np.pi / 120
    sinograms = dots.sinograms(theta, 40.0, 81)
    radon = Radon(theta, 40.0, 81, 81)
    slices = mapped(sinograms, radon, 0.0, faintest=0.05)
    assert slices.min() < 0
    assert np.mean(slices == 0) > 0.3
    left = seen(sinograms) - radon.project(slices)
    assert np.std(left) < 0.03 * np.std(sinograms)
