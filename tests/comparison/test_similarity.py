from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.comparison import SIMILARITY, Findings
from tomoslam_stage.comparison.regions import disc
from tomoslam_stage.comparison.similarity import psnr, similarity, ssim
from tomoslam_stage.products import Pixels

SIDE = 64
INSIDE = disc((SIDE, SIDE))


def noise(seed: int) -> Pixels:
    return np.random.default_rng(seed).normal(size=(SIDE, SIDE)).astype(np.float32)


def test_psnr_of_a_known_error() -> None:
    true = np.zeros((SIDE, SIDE), np.float32)
    true[30, 30] = 4.0
    # A hundredth of the range everywhere: 40 dB.
    assert psnr(true + 0.04, true, INSIDE) == pytest.approx(40, abs=1e-4)
    assert psnr(true, true, INSIDE) == np.inf


def test_ssim_of_a_slice_with_itself_is_one() -> None:
    assert ssim(noise(1), noise(1), INSIDE) == pytest.approx(1, abs=1e-12)


def test_ssim_of_a_brighter_slice_is_its_luminance_term() -> None:
    # Of flat grey values x and y: (2 x y + c1) / (x^2 + y^2 + c1), c1 = (0.01 * range)^2.
    true = np.zeros((SIDE, SIDE))
    true[:, SIDE // 2 :] = 2
    apart = INSIDE & (np.abs(np.arange(SIDE) - SIDE / 2) > 6)
    first = (0.01 * 2) ** 2
    terms = (2 * true * (true + 1) + first) / (true**2 + (true + 1) ** 2 + first)
    assert ssim(true + 1, true, apart) == pytest.approx(terms[apart].mean(), rel=1e-9)


def test_ssim_is_the_published_formula_with_windows_that_end_at_the_disc() -> None:
    side = 21
    inside, (z, x) = disc((side, side)), np.mgrid[:side, :side]
    first, second = (noise(k)[:side, :side].astype(np.float64) for k in (1, 2))
    c1, c2 = ((k * np.ptp(second[inside])) ** 2 for k in (0.01, 0.03))
    found = []
    for at in np.argwhere(inside):
        near = inside & (np.abs(z - at[0]) <= 5) & (np.abs(x - at[1]) <= 5)
        weight = near * np.exp(-((z - at[0]) ** 2 + (x - at[1]) ** 2) / (2 * 1.5**2))
        (a, b), both = (
            (np.average(one, weights=weight) for one in (first, second)),
            np.cov(first[near], second[near], aweights=weight[near], ddof=0),
        )
        luminance = (2 * a * b + c1) / (a**2 + b**2 + c1)
        found.append(luminance * (2 * both[0, 1] + c2) / (both[0, 0] + both[1, 1] + c2))
    assert ssim(first, second, inside) == pytest.approx(np.mean(found), rel=1e-9)


def test_ssim_does_not_depend_on_the_unit_of_grey_values() -> None:
    first = ssim(noise(1), noise(2), INSIDE)
    assert ssim(1e-3 * noise(1), 1e-3 * noise(2), INSIDE) == pytest.approx(first, rel=1e-4)


@pytest.mark.parametrize("name", SIMILARITY)
def test_likeness_falls_with_every_bit_of_noise_and_ignores_the_corners(name: str) -> None:
    from scipy.ndimage import gaussian_filter

    measure, true = SIMILARITY[name], np.asarray(gaussian_filter(noise(1), 3), np.float32)
    values = [measure(true + s * noise(2), true, INSIDE) for s in (0.01, 0.03, 0.1)]
    assert values == sorted(values, reverse=True)
    spoiled = np.where(INSIDE, true + 0.03 * noise(2), 1e6).astype(np.float32)
    assert measure(spoiled, true, INSIDE) == values[1]


def test_likeness_is_told_of_recorded_and_refined_where_there_is_truth(complete: Findings) -> None:
    made = similarity(complete.reconstructions)
    assert set(made) == {"psnr", "ssim"}
    for values in made.values():
        assert set(values) == {"recorded", "refined"}
        assert values["refined"] > values["recorded"]
    without = {n: one for n, one in complete.reconstructions.items() if n != "true"}
    assert similarity(without) == {}


def test_likeness_is_the_mean_over_the_slices(complete: Findings) -> None:
    made = complete.reconstructions
    single = [
        similarity({n: replace(made[n], slices=made[n].slices[k : k + 1]) for n in NAMES})
        for k in range(3)
    ]
    for metric, values in similarity(made).items():
        each = [one[metric]["recorded"] for one in single]
        assert values["recorded"] == pytest.approx(np.mean(each))


NAMES = ("recorded", "refined", "true")
