from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.comparison.frc import (
    RingCorrelation,
    half_bit,
    ring_correlation,
    tapered_disc,
)
from tomoslam_stage.products import Floats, Pixels

SIDE = 96


def noise(seed: int, rows: int = 1) -> Pixels:
    return np.random.default_rng(seed).normal(size=(rows, SIDE, SIDE)).astype(np.float32)


def band_limited(finest_px: float) -> Pixels:
    """White noise without anything finer than `finest_px`."""
    spectrum = np.fft.fft2(noise(9)[0])
    f = np.fft.fftfreq(SIDE)
    spectrum[np.hypot(f[:, None], f) > 1 / finest_px] = 0
    image = np.fft.ifft2(spectrum).real
    return np.asarray(image / image.std(), np.float32)[None]


def test_the_same_slices_agree_at_every_frequency_whatever_their_scale_and_offset() -> None:
    found = ring_correlation(noise(1), 3 * noise(1) + 7)
    assert found.correlation == pytest.approx(np.ones(SIDE // 2), abs=1e-5)
    assert found.resolution_px == 2
    assert found.frequency[[0, -1]] == pytest.approx([1 / SIDE, 0.5])


def test_opposite_slices_disagree_at_every_frequency() -> None:
    assert ring_correlation(noise(1), -noise(1)).correlation == pytest.approx(
        -np.ones(SIDE // 2), abs=1e-5
    )


def test_independent_noise_does_not_correlate_and_more_rows_tell_it_better() -> None:
    few, many = (ring_correlation(noise(1, rows), noise(2, rows)) for rows in (1, 8))
    assert abs(few.correlation.mean()) < 0.05
    # Rings near the middle have but a few pixels.
    assert many.correlation[8:].std() < few.correlation[8:].std() / 2
    assert (many.threshold < few.threshold).all()


@pytest.mark.parametrize("finest_px", [4.0, 6.0])
def test_the_resolution_is_where_detail_ends(finest_px: float) -> None:
    detail = band_limited(finest_px)
    found = ring_correlation(detail + 0.5 * noise(1), detail + 0.5 * noise(2))
    # The disc smears a spectrum over two rings or so.
    assert 1 / found.resolution_px == pytest.approx(1 / finest_px, abs=3 / SIDE)


def test_more_noise_means_a_poorer_resolution() -> None:
    detail = band_limited(2.5)
    blurred = np.fft.ifft2(np.fft.fft2(detail) * np.exp(-((8 * np.hypot(*_grid())) ** 2))).real
    found = [
        ring_correlation(*(np.asarray(blurred + s * noise(k), np.float32) for k in (1, 2)))
        for s in (0.01, 0.05, 0.2)
    ]
    resolution = [one.resolution_px for one in found]
    assert resolution == sorted(resolution)
    assert resolution[2] > 1.3 * resolution[0]


def _grid() -> list[Floats]:
    f = np.fft.fftfreq(SIDE)
    return list(np.meshgrid(f, f, indexing="ij"))


def test_what_lies_outside_the_field_of_view_does_not_count() -> None:
    spoiled = noise(1)
    spoiled[:, :10, :10] = 1e4
    clean = ring_correlation(noise(1), noise(2)).correlation
    assert ring_correlation(spoiled, noise(2)).correlation == pytest.approx(clean, abs=1e-6)


def test_the_disc_fades_out() -> None:
    window = tapered_disc((SIDE, SIDE))
    middle = window[SIDE // 2]
    assert middle[SIDE // 2] == 1
    assert middle[0] == 0
    assert np.abs(np.diff(middle)).max() < 0.4
    assert window == pytest.approx(window.T[::-1])


def test_the_threshold_is_the_half_bit_curve() -> None:
    # Van Heel and Schatz: (0.2071 + 1.9102 / sqrt(n)) / (1.2071 + 0.9102 / sqrt(n)).
    n = np.array([1.0, 16.0, 400.0, 1e12])
    published = (0.2071 + 1.9102 / np.sqrt(n)) / (1.2071 + 0.9102 / np.sqrt(n))
    assert half_bit(n) == pytest.approx(published, abs=1e-4)


def test_the_resolution_is_interpolated_between_rings() -> None:
    frequency, flat = np.array([0.1, 0.2, 0.3]), np.full(3, 0.5)
    made = RingCorrelation(frequency, np.array([0.9, 0.7, 0.3]), flat)
    assert made.resolution_px == pytest.approx(1 / 0.25)


@pytest.mark.parametrize("first", [0.2, np.nan])
def test_there_is_no_resolution_where_nothing_agrees_from_the_start(first: float) -> None:
    made = RingCorrelation(np.array([0.1, 0.2]), np.array([first, 0.9]), np.full(2, 0.5))
    assert np.isnan(made.resolution_px)


def test_empty_slices_have_no_resolution() -> None:
    nothing = np.zeros((1, 32, 32), np.float32)
    assert np.isnan(ring_correlation(nothing, nothing).resolution_px)


@pytest.mark.parametrize("side", [1, 2, 3, 31])
def test_slices_of_any_size_can_be_correlated(side: int) -> None:
    image = np.random.default_rng(1).normal(size=(2, side, side)).astype(np.float32)
    assert len(ring_correlation(image, image).correlation) == side // 2
