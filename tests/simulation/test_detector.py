from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.simulation.detector import FULL, Camera, Detector, camera

SHAPE = (60, 80)
CLEAN = {"dust": 0, "hot": 0, "gain": 0.0, "beam_fall": 0.0}


def made(**settings: float) -> Camera:
    return camera(Detector(**settings), SHAPE, np.random.default_rng(1))


def rng() -> np.random.Generator:
    return np.random.default_rng(2)


def test_counts_scatter_as_photons_and_readout_do() -> None:
    flat = made(**CLEAN, counts=12_000, readout=30.0, offset=200.0).projection(
        np.zeros(SHAPE), rng()
    )
    assert flat.dtype == np.uint16
    assert flat.mean() == pytest.approx(12_200, rel=2e-3)
    assert flat.std() == pytest.approx(np.sqrt(12_000 + 30**2), rel=0.05)


@pytest.mark.parametrize("photons", [0.25, 4.0, 25.0])
def test_more_photons_make_the_same_counts_less_noisy(photons: float) -> None:
    settings = CLEAN | {"counts": 12_000, "readout": 0.0, "offset": 200.0}
    flat = made(**settings, photons=photons).projection(np.zeros(SHAPE), rng())
    assert flat.mean() == pytest.approx(12_200, rel=2e-3)
    assert flat.std() == pytest.approx(np.sqrt(12_000 / photons), rel=0.05)


def test_readout_noise_does_not_fall_with_photons() -> None:
    settings = CLEAN | {"counts": 10_000, "readout": 30.0, "photons": 100.0}
    flat = made(**settings).projection(np.zeros(SHAPE), rng())
    assert flat.std() == pytest.approx(np.sqrt(10_000 / 100 + 30**2), rel=0.05)


def test_object_dims_the_beam_as_beer_and_lambert_say() -> None:
    counts = made(**CLEAN, offset=0.0).projection(np.full(SHAPE, 2.0), rng())
    assert counts.mean() == pytest.approx(20_000 * np.exp(-2), rel=3e-3)


@pytest.mark.parametrize("sigma", [0.8, 1.5])
def test_blur_spreads_an_edge_by_its_sigma(sigma: float) -> None:
    edge = np.zeros(SHAPE)
    edge[:, 40:] = 3.0
    counts = made(**CLEAN, counts=60_000, blur=sigma, offset=0.0, readout=0.0).projection(
        edge, rng()
    )
    spread = -np.diff(counts.mean(axis=0))[20:60]
    at = np.arange(20, 60) - (spread * np.arange(20, 60)).sum() / spread.sum()
    assert np.sqrt((spread * at**2).sum() / spread.sum()) == pytest.approx(sigma, rel=0.1)


def test_gain_and_beam_are_gone_after_flat_fielding() -> None:
    settings = {"dust": 0, "hot": 0, "gain": 0.1, "whites": 200, "darks": 50, "readout": 0.0}
    eye = made(**settings)
    white, dark = eye.whites(rng()).mean(axis=0), eye.darks(rng()).mean(axis=0)
    counts = eye.projection(np.full(SHAPE, 0.5), np.random.default_rng(3))
    assert (white - dark).std() > 0.09 * white.mean()
    transmission = (counts - dark) / (white - dark)
    assert transmission.std() < 1.25 * np.sqrt(np.exp(-0.5) / 17_000)
    assert transmission.mean() == pytest.approx(np.exp(-0.5), rel=3e-3)


def test_dust_and_hot_pixels_outlive_flat_fielding_where_they_are() -> None:
    eye = made(dust_shift=0.5, dust_depth=0.5, whites=50)
    white, dark = eye.whites(rng()).mean(axis=0), eye.darks(rng()).mean(axis=0)
    pictures = [
        (eye.projection(np.zeros(SHAPE), np.random.default_rng(k)) - dark) / (white - dark)
        for k in (3, 4)
    ]
    speck = eye.beam < 0.9 * eye.beam_before
    hot = eye.base > eye.base_before + 1000
    assert speck.sum() > 20
    assert hot.sum() > 3
    for transmission in pictures:
        assert transmission[speck & ~hot].mean() < 0.92
        assert transmission[hot].mean() > 1.02
        assert transmission[~speck & ~hot].mean() == pytest.approx(1, abs=0.01)


def test_without_shift_flat_fielding_removes_dust_and_hot_pixels() -> None:
    eye = made(dust_shift=0.0)
    np.testing.assert_array_equal(eye.beam, eye.beam_before)
    np.testing.assert_array_equal(eye.base, eye.base_before)


def test_counts_saturate_at_sixteen_bits() -> None:
    counts = made(**CLEAN, counts=90_000).projection(np.zeros(SHAPE), rng())
    assert np.all(counts == FULL)


def test_darks_show_offset_and_readout_only() -> None:
    darks = made(**CLEAN, offset=150.0, readout=5.0, darks=7).darks(rng())
    assert darks.shape == (7, *SHAPE)
    assert darks.mean() == pytest.approx(150, abs=0.2)
    assert darks.std() == pytest.approx(5, rel=0.05)
