from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tomoslam_stage.images import (
    Window,
    bandpass,
    highpass,
    mirrored,
    noise_sigma,
    ramp,
    robust_sigma,
    shifted,
    still,
    tapered,
)

if TYPE_CHECKING:
    from conftest import Blobs

    from tomoslam_stage.products import Pixels

MIDDLE = slice(150, 250)
"""Columns far enough from the ends of 400."""


def wave(period: float) -> Pixels:
    """(400,) a cosine along the columns."""
    return np.cos(2 * np.pi * np.arange(400) / period).astype(np.float32)


def passed(period: float, sigma: float) -> float:
    """Share of a wave that a Gaussian of `sigma` px lets through."""
    return float(np.exp(-2 * (np.pi * sigma / period) ** 2))


@pytest.mark.parametrize("period", [6.0, 25.0, 50.0, 100.0])
def test_highpass_keeps_of_a_wave_what_a_gaussian_takes_away(period: float) -> None:
    left = highpass(wave(period)[None, None], 8.0)
    assert left.dtype == np.float32
    wanted = (1 - passed(period, 8.0)) * wave(period)[MIDDLE]
    np.testing.assert_allclose(left[0, 0, MIDDLE], wanted, atol=2e-3)


def test_highpass_looks_along_the_columns_alone() -> None:
    levels = np.random.default_rng(0).normal(size=(3, 7, 1)).astype(np.float32)
    flat = np.broadcast_to(levels, (3, 7, 40))
    np.testing.assert_allclose(highpass(flat, 8.0), 0, atol=1e-5)


@pytest.mark.parametrize("fine", [0.0, 1.2, 3.0])
@pytest.mark.parametrize("along", ["rows", "columns"])
def test_bandpass_keeps_of_a_wave_what_lies_between_two_gaussians(fine: float, along: str) -> None:
    stripes = np.broadcast_to(wave(20.0), (100, 400))
    projection = stripes if along == "columns" else stripes.T
    kept = bandpass(projection, fine, 10.0)
    assert kept.dtype == np.float32
    cut = kept[50, MIDDLE] if along == "columns" else kept[MIDDLE, 50]
    share = passed(20.0, fine) - passed(20.0, 10.0)
    np.testing.assert_allclose(cut, share * wave(20.0)[MIDDLE], atol=2e-3)


def test_noise_is_measured_where_ramps_and_edges_are() -> None:
    noise = np.random.default_rng(3).normal(0, 0.3, (200, 200))
    row, column = np.indices(noise.shape)
    ramps_and_edges = 0.5 * row - 0.2 * column + 0.01 * row * column + 20 * (column > 77)
    assert noise_sigma(noise.astype(np.float32)) == pytest.approx(0.3, rel=0.03)
    found = noise_sigma((noise + ramps_and_edges).astype(np.float32))
    assert found == pytest.approx(0.3, rel=0.04)


@pytest.mark.parametrize("shape", [(1, 50), (2, 50), (50, 2)])
def test_an_image_too_thin_for_second_differences_has_no_measurable_noise(
    shape: tuple[int, int],
) -> None:
    noise = np.random.default_rng(3).normal(0, 0.3, shape).astype(np.float32)
    assert noise_sigma(noise) == 0
    assert noise_sigma(np.resize(noise, (3, 3))) > 0


def test_robust_sigma_is_that_of_normal_noise_and_outliers_hardly_move_it() -> None:
    values = np.random.default_rng(4).normal(7, 2, 20_000).astype(np.float32)
    assert robust_sigma(values) == pytest.approx(2, rel=0.03)
    values[:1000] = 1e6
    assert robust_sigma(values) == pytest.approx(2, rel=0.1)


def test_the_ramp_is_the_spectrum_of_the_sampled_kernel_of_ram_and_lak() -> None:
    kernel = np.fft.irfft(ramp(32, "ram-lak"))
    wanted = [0.25, -1 / np.pi**2, 0, -1 / (3 * np.pi) ** 2, 0, -1 / (5 * np.pi) ** 2]
    np.testing.assert_allclose(kernel[:6], wanted, atol=1e-12)
    np.testing.assert_allclose(kernel[1:], kernel[:0:-1], atol=1e-12)
    np.testing.assert_allclose(ramp(4096, "ram-lak"), np.fft.rfftfreq(4096), atol=1e-3)


@pytest.mark.parametrize(
    ("window", "at_half", "at_end"),
    [("shepp-logan", np.sqrt(8) / np.pi, 2 / np.pi), ("hann", 0.5, 0.0)],
)
def test_windows_leave_low_frequencies_and_damp_high_ones(
    window: Window, at_half: float, at_end: float
) -> None:
    share = ramp(64, window) / ramp(64, "ram-lak")
    np.testing.assert_allclose(share[[0, 16, 32]], [1, at_half, at_end], atol=1e-12)


def test_padding_falls_from_the_end_values_to_zero_on_either_side() -> None:
    sinograms = np.array([[[4.0, 1.0, 2.0], [8.0, 0.0, 6.0]]], np.float32)
    padded = tapered(sinograms, before=4, length=11)
    down = 0.5 + 0.5 * np.cos(np.pi * np.array([1, 2, 3, 4]) / 4)
    for row, (left, right) in enumerate([(4, 2), (8, 6)]):
        np.testing.assert_allclose(padded[0, row, :4], left * down[::-1], atol=1e-6)
        np.testing.assert_allclose(padded[0, row, 7:], right * down, atol=1e-6)
    np.testing.assert_array_equal(padded[..., 4:7], sinograms)


def test_padding_by_nothing_changes_nothing() -> None:
    sinograms = np.array([[[4.0, 1.0, 2.0]]], np.float32)
    np.testing.assert_array_equal(tapered(sinograms, before=0, length=3), sinograms)


def test_rows_are_shifted_each_by_its_own_amount(blobs: Blobs) -> None:
    theta = np.linspace(0, 3, 7)
    by = np.array([0.0, 0.3, -1.7])
    wanted = [blobs.sinograms(theta, 31 + b, 64)[k] for k, b in enumerate(by)]
    found = shifted(blobs.sinograms(theta, 31.0, 64), by[:, None])
    np.testing.assert_allclose(found, wanted, atol=2e-3)


def test_what_is_mirrored_is_what_is_seen_half_a_turn_on(blobs: Blobs) -> None:
    theta = np.linspace(0, 3, 7)
    behind = blobs.sinograms(theta + np.pi, 29.7, 64)
    np.testing.assert_allclose(mirrored(blobs.sinograms(theta, 29.7, 64), 29.7), behind, atol=2e-3)


def test_what_jittered_stands_still_again_in_every_row(blobs: Blobs) -> None:
    theta = np.linspace(0, 3, 7)
    shift = np.array([0.0, 0.3, -1.7, 0.4, 0.9, -0.2, 0.6])
    sinograms = [blobs.sinograms(theta[k : k + 1], 31 + s, 64) for k, s in enumerate(shift)]
    moved = np.concatenate(sinograms, axis=1)
    np.testing.assert_allclose(still(moved, shift), blobs.sinograms(theta, 31.0, 64), atol=2e-3)
    assert still(moved, None) is moved
