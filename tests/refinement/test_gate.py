from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements, Evidence, Tracks
from tomoslam_stage.refinement import Halves, nothing_measured, weigh
from tomoslam_stage.refinement.gate import Gate, gain_sigma

GOOD = Evidence(
    half_error_deg=0.05,
    recorded_error_deg=0.25,
    half_measured=0.6,
    residual_recorded=0.1,
    residual_refined=0.09,
    residual_gain_sigma=7.5,
)

HALVES = (
    "two halves of the tracks put the error of the refined angles at 0.05 degrees and that of the "
    "recorded ones at 0.25"
)
FALLS = (
    "on rows that were not used the squared reprojection residual falls by 19.0% (+7.5 standard "
    "errors)"
)


def test_angles_stand_when_both_kinds_of_evidence_speak_for_them() -> None:
    verdict = Gate().judge(GOOD)
    assert verdict.status == "accepted"
    assert verdict.reason == f"{HALVES}; {FALLS}"


def test_recorded_angles_are_kept_when_the_halves_disagree() -> None:
    verdict = Gate().judge(replace(GOOD, half_error_deg=0.2))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "two halves of the tracks put the error of the refined angles at 0.2 degrees and that of "
        "the recorded ones at 0.25; less than 0.7 of it is needed"
    )


def test_recorded_angles_are_kept_when_a_half_measures_next_to_nothing() -> None:
    verdict = Gate().judge(replace(GOOD, half_measured=0.24))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "half of the tracks measures 24% of the triplets that all of them measure, so that the "
        "halves say little; 25% is needed"
    )


def test_recorded_angles_are_kept_when_unused_rows_do_not_reproject_better() -> None:
    verdict = Gate().judge(replace(GOOD, residual_gain_sigma=2.9))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "on rows that were not used the squared reprojection residual falls by 19.0% (+2.9 "
        "standard errors); a fall by 3 or more is needed"
    )


def test_recorded_angles_are_kept_when_unused_rows_reproject_worse() -> None:
    verdict = Gate().judge(replace(GOOD, residual_refined=0.11, residual_gain_sigma=-4.0))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "on rows that were not used the squared reprojection residual rises by 21.0% (-4.0 "
        "standard errors); a fall by 3 or more is needed"
    )


def test_both_reasons_are_told_when_nothing_speaks_for_the_refined_angles() -> None:
    verdict = Gate().judge(replace(GOOD, recorded_error_deg=0.0, residual_gain_sigma=0.0))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "two halves of the tracks put the error of the refined angles at 0.05 degrees and that of "
        "the recorded ones at 0; less than 0.7 of it is needed; on rows that were not used the "
        "squared reprojection residual falls by 19.0% (+0.0 standard errors); a fall by 3 or more "
        "is needed"
    )


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"half_error_deg": 0.7 * 0.25}, "kept"),
        ({"half_error_deg": 0.174}, "accepted"),
        ({"half_measured": 0.25}, "accepted"),
        ({"half_measured": np.nextafter(0.25, 0)}, "kept"),
        ({"residual_gain_sigma": 3.0}, "accepted"),
        ({"residual_gain_sigma": np.nextafter(3.0, 0)}, "kept"),
    ],
)
def test_the_limits_are_where_they_are_said_to_be(change: dict[str, float], status: str) -> None:
    assert Gate().judge(replace(GOOD, **change)).status == status


def test_a_stricter_gate_keeps_what_the_default_one_accepts() -> None:
    assert Gate(half_share=0.1).judge(GOOD).status == "kept"
    assert Gate(half_measured=0.7).judge(GOOD).status == "kept"
    assert Gate(significance=8).judge(GOOD).status == "kept"


def test_empty_rows_speak_for_nothing() -> None:
    empty = replace(GOOD, residual_recorded=0.0, residual_refined=0.0, residual_gain_sigma=0.0)
    assert Gate().judge(empty).reason == (
        "on rows that were not used the squared reprojection residual falls by 0.0% (+0.0 standard "
        "errors); a fall by 3 or more is needed"
    )


@pytest.fixture
def tracks() -> Tracks:
    return Tracks(
        feature=np.array([0, 0, 1, 1]),
        projection=np.array([0, 1, 1, 2]),
        column=np.zeros(4),
        row=np.zeros(4),
        keypoints=np.array([3, 4, 6]),
    )


def test_reason_counts_why_no_triplet_was_measured(
    tracks: Tracks, unmeasured: AngleMeasurements
) -> None:
    failed = replace(unmeasured, failures={"too few tracks": 12, "near-degenerate": 3})
    verdict = nothing_measured(tracks, failed)
    assert verdict.status == "kept"
    assert verdict.reason == (
        "no triplet of projections could be measured (too few tracks: 12, near-degenerate: 3); "
        "4.3 keypoints a projection gave 2 tracks"
    )


def test_reason_says_when_there_was_no_triplet_to_measure(
    tracks: Tracks, unmeasured: AngleMeasurements
) -> None:
    assert nothing_measured(tracks, unmeasured).reason == (
        "no triplet of projections could be measured (no track runs through one); "
        "4.3 keypoints a projection gave 2 tracks"
    )


def test_halves_show_the_error_of_the_whole_and_of_the_recorded_angles() -> None:
    rng = np.random.default_rng(0)
    true = np.linspace(0, 6, 20_000)
    first, second = true + rng.normal(0, 0.02, (2, 20_000))
    whole = (first + second) / 2
    halves = Halves(whole, first + 0.3, second - 0.2, measured=1.0)
    assert halves.error == pytest.approx(np.std(whole - true), rel=0.02)
    recorded = true + rng.normal(0, 0.05, 20_000) + 0.4
    assert halves.error_of(recorded) == pytest.approx(0.05, rel=0.02)
    assert halves.error_of(whole) == 0


def test_sigma_is_widened_to_what_the_halves_show_and_never_narrowed() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(0, 0.02 * np.sqrt(2), (2, 20_000))
    halves = Halves((first + second) / 2, first, second, measured=1.0)
    assert halves.excess(np.full(20_000, 0.005)) == pytest.approx(4, rel=0.03)
    assert halves.excess(np.full(20_000, 0.05)) == 1
    assert halves.excess(np.zeros(20_000)) == 1


def test_evidence_holds_the_numbers_in_degrees() -> None:
    rng = np.random.default_rng(1)
    true = np.linspace(0, 6, 400)
    recorded = true + np.deg2rad(rng.normal(0, 0.3, 400))
    parts = (true + np.deg2rad(s * rng.normal(0, 0.02, 400)) for s in (1, 2**0.5, 2**0.5))
    halves = Halves(*parts, measured=0.4)
    squares = {"recorded": rng.uniform(3.9, 4.1, (6, 400)), "refined": np.ones((6, 400))}
    evidence = weigh(recorded, halves, squares)
    assert evidence.half_error_deg == pytest.approx(0.02, rel=0.15)
    assert evidence.recorded_error_deg == pytest.approx(0.3, rel=0.1)
    assert evidence.residual_recorded == pytest.approx(2, rel=0.01)
    assert evidence.half_measured == 0.4
    assert evidence.residual_refined == 1
    assert evidence.residual_gain_sigma > 100


def test_a_gain_counts_in_standard_errors_over_rows_and_parts_of_the_turn() -> None:
    theta = np.random.default_rng(0).permutation(np.linspace(0, 6, 160))
    scores = [
        gain_sigma(np.random.default_rng(seed).normal(0.0, 1, (9, 160)), theta)
        for seed in range(300)
    ]
    assert abs(np.mean(scores)) < 0.2
    assert np.std(scores) == pytest.approx(1, abs=0.15)


def test_a_gain_in_one_part_of_the_turn_only_is_no_sure_gain() -> None:
    theta = np.linspace(0, 6, 160)
    everywhere = np.ones((6, 160)) + np.random.default_rng(0).normal(0, 0.5, (6, 160))
    somewhere = 8 * everywhere * (np.arange(160) < 20)
    assert gain_sigma(everywhere, theta) > 20
    assert 0 < gain_sigma(somewhere, theta) < 3
    order = np.random.default_rng(1).permutation(160)
    assert gain_sigma(somewhere[:, order], theta[order]) == pytest.approx(
        gain_sigma(somewhere, theta)
    )


@pytest.mark.parametrize("shape", [(1, 1), (3, 5)])
def test_no_difference_is_no_gain(shape: tuple[int, int]) -> None:
    assert gain_sigma(np.zeros(shape), np.linspace(0, 1, shape[1])) == 0
