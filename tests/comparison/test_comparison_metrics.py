from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.comparison import SHARPNESS, Findings, compare
from tomoslam_stage.comparison.metrics import difference_of_angles
from tomoslam_stage.comparison.regions import disc, grey_limits, material, most_changed_window
from tomoslam_stage.products import Reconstructions, Refinement, Truth

BOTH = ("recorded", "refined")
AXES = {"recorded": 39.5, "refined": 39.5}


@pytest.mark.parametrize("name", SHARPNESS)
def test_every_sharpness_figure_falls_when_a_slice_is_blurred(name: str) -> None:
    from scipy.ndimage import gaussian_filter

    image = np.random.default_rng(1).normal(size=(60, 60)).astype(np.float32)
    inside = disc(image.shape)
    measure = SHARPNESS[name]
    assert measure(gaussian_filter(image, 1.5), inside) < 0.8 * measure(image, inside)


@pytest.mark.parametrize("name", SHARPNESS)
def test_no_sharpness_figure_looks_outside_the_disc(name: str) -> None:
    image = np.random.default_rng(1).normal(size=(61, 61)).astype(np.float32)
    inside = disc(image.shape)
    seen = np.hypot(*(np.mgrid[:61, :61] - 30)) <= 30
    spoiled = np.where(seen, image, 1e6).astype(np.float32)
    assert SHARPNESS[name](spoiled, inside) == SHARPNESS[name](image, inside)


def test_gradient_figures_know_a_ramp() -> None:
    ramp = np.broadcast_to(0.5 * np.arange(40, dtype=np.float32), (40, 40))
    inside = disc(ramp.shape)
    assert SHARPNESS["total_variation"](ramp, inside) == pytest.approx(0.5)
    assert SHARPNESS["gradient_energy"](ramp, inside) == pytest.approx(0.25)


def test_truth_changes_nothing_but_the_errors(refinement: Refinement, complete: Findings) -> None:
    made = {n: one for n, one in complete.reconstructions.items() if not n.startswith("true")}
    blind, informed = compare(refinement, made), complete.comparison
    assert blind.errors == blind.similarity == {}
    assert informed.errors
    assert set(informed.similarity["psnr"]) == set(informed.similarity["ssim"]) == set(BOTH)
    for name in BOTH:
        np.testing.assert_array_equal(blind.frc[name], informed.frc[name])
        assert blind.frc_resolution_px[name] == informed.frc_resolution_px[name]
        assert blind.edge_width_px[name] == informed.edge_width_px[name]
        for metric, values in blind.sharpness.items():
            assert values[name] == informed.sharpness[metric][name]


def test_errors_are_those_of_equation_7_and_with_the_mean_removed(truth: Truth) -> None:
    n = len(truth.theta)
    drift = np.radians(0.3) * np.arange(n) / (n - 1)
    offset = np.radians(5.0)
    refinement = Refinement(
        truth.theta + drift + offset, truth.theta + drift / 4, drift, "accepted", "", AXES
    )
    errors = compare(refinement, {}, truth).errors
    assert errors["recorded_rms_deg"] == pytest.approx(0.3 * np.std(np.linspace(0, 1, n)))
    rms_first_fixed = 0.3 * np.sqrt(np.mean(np.linspace(0, 1, n) ** 2))
    assert errors["recorded_rms_first_fixed_deg"] == pytest.approx(rms_first_fixed)
    assert errors["refined_rms_first_fixed_deg"] == pytest.approx(rms_first_fixed / 4)
    assert errors["error_ratio"] == pytest.approx(4)


def test_error_ratio_is_one_where_recorded_angles_are_exact_and_stay(truth: Truth) -> None:
    same = Refinement(truth.theta, truth.theta, truth.theta * 0, "kept", "", AXES)
    assert compare(same, {}, truth).errors["error_ratio"] == 1


def test_error_ratio_is_infinite_where_refined_angles_are_exact(
    refinement: Refinement, truth: Truth
) -> None:
    exact = replace(refinement, refined=truth.theta)
    assert compare(exact, {}, truth).errors["error_ratio"] == np.inf


def test_whole_turns_of_single_projections_are_no_errors() -> None:
    theta = np.array([0.1, 0.2, 0.3, 0.4])
    turned = theta + 2 * np.pi * np.array([0, 0, 1, 0])
    assert difference_of_angles(turned, theta) == pytest.approx(np.zeros(4))


@pytest.mark.parametrize("name", ["residual", "truth"])
def test_lengths_that_differ_are_refused(refinement: Refinement, name: str) -> None:
    if name == "residual":
        refinement = replace(refinement, reprojection={"recorded": np.ones(3)})
    truth = Truth(np.ones(3)) if name == "truth" else None
    with pytest.raises(ValueError, match=r"\(3,\) values for \(90,\) angles"):
        compare(refinement, {}, truth)


def test_slices_of_different_rows_are_not_compared(
    refinement: Refinement, reconstructions: Reconstructions
) -> None:
    other = replace(reconstructions["refined"], rows=np.array([2, 7, 12]))
    with pytest.raises(ValueError, match="same rows and size"):
        compare(refinement, {**reconstructions, "refined": other})


def test_halves_may_have_fewer_rows_but_all_of_them_the_same(
    refinement: Refinement, complete: Findings
) -> None:
    made = dict(complete.reconstructions)
    assert made["recorded_odd"].rows.tolist() == [7]
    made["recorded_odd"] = replace(made["recorded_odd"], rows=np.array([2]))
    with pytest.raises(ValueError, match=r"same rows.*rows \(7,\).*recorded_odd: rows \(2,\)"):
        compare(refinement, made)


def test_a_half_without_the_other_is_not_correlated(
    refinement: Refinement, complete: Findings
) -> None:
    made = {n: one for n, one in complete.reconstructions.items() if n != "refined_odd"}
    assert set(compare(refinement, made).frc) == {"recorded", "true"}


def test_the_most_changed_window_is_found_and_what_lies_outside_the_disc_is_not() -> None:
    difference = np.zeros((100, 100), np.float32)
    difference[60:64, 30:34] = 1
    difference[:10, :10] = 50
    top, left, side = most_changed_window(difference, disc(difference.shape))
    assert side == 20
    assert top <= 60
    assert top + side >= 64
    assert left <= 30
    assert left + side >= 34


def test_streaks_in_air_do_not_win_over_a_smaller_change_inside_the_object() -> None:
    z, x = np.mgrid[:100, :100]
    body = np.asarray(0.01 * (np.hypot(z - 65, x - 40) < 20), np.float32)
    inside, difference = disc(body.shape), np.zeros((100, 100), np.float32)
    difference[12:26:2, 45:60] = 0.01
    difference[60:64, 34:38] = 0.004
    assert most_changed_window(difference, inside).top < 26
    top, left, side = most_changed_window(difference * material(body, inside), inside)
    assert top <= 60
    assert top + side >= 64
    assert left <= 34
    assert left + side >= 38


def test_material_goes_from_none_in_air_to_one_in_what_attenuates_most() -> None:
    z, x = np.mgrid[:100, :100]
    body = 0.002 * (np.hypot(z - 50, x - 50) < 35) + 0.008 * (np.hypot(z - 50, x - 40) < 12)
    body[:8, :8] = 5.0
    body[20, 60] = np.nan
    there = material(body, disc(body.shape))
    assert there.min() == there[4, 50] == 0
    assert there.max() == there[50, 40] == 1
    assert there[50, 70] == pytest.approx(0.2, abs=0.01)


def test_where_there_is_no_material_every_change_counts() -> None:
    nothing = np.zeros((50, 50), np.float32)
    for image in (nothing, nothing - 1):
        assert (material(image, disc(image.shape)) == 1).all()


def test_the_window_is_in_the_middle_where_nothing_changed() -> None:
    nothing = np.zeros((50, 50), np.float32)
    assert most_changed_window(nothing, disc(nothing.shape)) == (20, 20, 10)


def test_grey_limits_hold_both_images_and_ignore_extremes_and_nan() -> None:
    images = np.stack([np.full((50, 50), 1.0), np.full((50, 50), 3.0)])
    images[0, 25, 25], images[1, 25, 25] = 1e9, np.nan
    assert grey_limits(images, disc((50, 50))) == (1.0, 3.0)


@pytest.mark.parametrize("value", [0.0, 2.0, np.nan])
def test_grey_limits_of_a_flat_slice_are_a_range(value: float) -> None:
    low, high = grey_limits(np.full((2, 9, 9), value), disc((9, 9)))
    assert low < high


@pytest.mark.parametrize("side", [1, 2, 3, 4, 101])
def test_the_disc_always_holds_the_middle(side: int) -> None:
    inside = disc((side, side))
    assert inside[side // 2, side // 2]
    assert np.array_equal(inside, inside[::-1].T)
