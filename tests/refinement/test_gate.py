from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements, Evidence, Rigidity, Tracks
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
    "two halves of the data put the error of the refined angles at 0.05 degrees and that of the "
    "recorded ones at 0.25"
)
FALLS = (
    "on rows that were not used the squared reprojection residual falls by 19.0% (+7.5 standard "
    "errors over rows and parts of the turn)"
)


def test_angles_stand_when_both_kinds_of_evidence_speak_for_them() -> None:
    verdict = Gate().judge(GOOD)
    assert verdict.status == "accepted"
    assert verdict.reason == f"{HALVES}; {FALLS}"


def test_recorded_angles_are_kept_when_the_halves_disagree() -> None:
    verdict = Gate().judge(replace(GOOD, half_error_deg=0.2))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "two halves of the data put the error of the refined angles at 0.2 degrees and that of "
        "the recorded ones at 0.25; less than 0.7 of it is needed"
    )


def test_recorded_angles_are_kept_when_a_half_measures_next_to_nothing() -> None:
    verdict = Gate().judge(replace(GOOD, half_measured=0.14))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "half of the tracks measures 14% of the triplets that all of them measure, so that the "
        "halves say little; 15% is needed"
    )


def test_recorded_angles_are_kept_when_unused_rows_do_not_reproject_better() -> None:
    verdict = Gate().judge(replace(GOOD, residual_gain_sigma=2.9))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "on rows that were not used the squared reprojection residual falls by 19.0% (+2.9 "
        "standard errors over rows and parts of the turn); a fall by 3 or more is needed"
    )


def test_recorded_angles_are_kept_when_unused_rows_reproject_worse() -> None:
    verdict = Gate().judge(replace(GOOD, residual_refined=0.11, residual_gain_sigma=-4.0))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "on rows that were not used the squared reprojection residual rises by 21.0% (-4.0 "
        "standard errors over rows and parts of the turn); a fall by 3 or more is needed"
    )


def test_both_reasons_are_told_when_nothing_speaks_for_the_refined_angles() -> None:
    verdict = Gate().judge(replace(GOOD, recorded_error_deg=0.0, residual_gain_sigma=0.0))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "two halves of the data put the error of the refined angles at 0.05 degrees and that of "
        "the recorded ones at 0; less than 0.7 of it is needed; on rows that were not used the "
        "squared reprojection residual falls by 19.0% (+0.0 standard errors over rows and parts "
        "of the turn); a fall by 3 or more is needed"
    )


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"half_error_deg": 0.7 * 0.25}, "kept"),
        ({"half_error_deg": 0.174}, "accepted"),
        ({"half_measured": 0.15}, "accepted"),
        ({"half_measured": np.nextafter(0.15, 0)}, "kept"),
        ({"residual_gain_sigma": 3.0}, "accepted"),
        ({"residual_gain_sigma": np.nextafter(3.0, 0)}, "kept"),
        ({"residual_refined": 0.1}, "kept"),
        ({"residual_refined": np.nextafter(0.1, 0)}, "accepted"),
    ],
)
def test_the_limits_are_where_they_are_said_to_be(change: dict[str, float], status: str) -> None:
    assert Gate().judge(replace(GOOD, **change)).status == status


RIGID = Rigidity(
    features=900,
    moved_px=0.02,
    moved_significance=9.0,
    cone_px=-0.1,
    cone_significance=-7.0,
)


def test_features_that_keep_their_rows_say_nothing_against() -> None:
    assert Gate().judge(replace(GOOD, rigidity=RIGID)) == Gate().judge(GOOD)


def test_recorded_angles_are_kept_when_rows_of_features_move() -> None:
    rigidity = replace(RIGID, moved_px=0.153, moved_significance=11.3)
    verdict = Gate().judge(replace(GOOD, rigidity=rigidity))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "rows of features move by 0.15 px rms as the scan goes on (11.3 standard errors), 0.04 px "
        "at most are allowed: the sample moves by itself or changes its size"
    )


def test_recorded_angles_are_kept_when_rows_of_features_move_apart_with_depth() -> None:
    rigidity = replace(RIGID, cone_px=-1.24, cone_significance=-8.1)
    verdict = Gate().judge(replace(GOOD, rigidity=rigidity))
    assert verdict.status == "kept"
    assert verdict.reason == (
        "rows of features at top and bottom move apart with depth by 1.2 px (8.1 standard errors), "
        "0.25 px at most are allowed: the beam is not parallel"
    )


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"moved_px": 0.04}, "accepted"),
        ({"moved_px": 0.041}, "kept"),
        ({"moved_px": 0.041, "moved_significance": 3.9}, "accepted"),
        ({"moved_px": 0.041, "pixel": 2}, "accepted"),
        ({"moved_px": 0.081, "pixel": 2}, "kept"),
        ({"cone_px": 0.25}, "accepted"),
        ({"cone_px": 0.26}, "kept"),
        ({"cone_px": -0.26, "cone_significance": -3.9}, "accepted"),
        ({"cone_px": -0.26, "pixel": 2}, "accepted"),
        ({"cone_px": 0.51, "pixel": 2}, "kept"),
    ],
)
def test_the_limits_of_rows_are_those_of_the_scan_as_it_is_refined(
    change: dict[str, float], status: str
) -> None:
    rigidity = replace(RIGID, **change)
    assert Gate().judge(replace(GOOD, rigidity=rigidity)).status == status


def test_a_residual_that_rises_is_no_fall_however_many_parts_fall_a_little() -> None:
    verdict = Gate(significance=0).judge(replace(GOOD, residual_refined=0.11))
    assert verdict.status == "kept"
    assert "rises by 21.0% (+7.5 standard errors" in verdict.reason


def test_a_stricter_gate_keeps_what_the_default_one_accepts() -> None:
    assert Gate(half_share=0.1).judge(GOOD).status == "kept"
    assert Gate(half_measured=0.7).judge(GOOD).status == "kept"
    assert Gate(significance=8).judge(GOOD).status == "kept"


def test_empty_rows_speak_for_nothing() -> None:
    empty = replace(GOOD, residual_recorded=0.0, residual_refined=0.0, residual_gain_sigma=0.0)
    assert Gate().judge(empty).reason == (
        "on rows that were not used the squared reprojection residual falls by 0.0% (+0.0 standard "
        "errors over rows and parts of the turn); a fall by 3 or more is needed"
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
    # Every one of 6 rows and 8 parts of the turn falls: the most that so many can say.
    assert evidence.residual_gain_sigma == pytest.approx(best_of(48))


def best_of(count: int) -> float:
    """Return the z score of `count` values that all have the same sign."""
    return float(np.sqrt(3 * count * (count + 1) / (2 * (2 * count + 1))))


def squares_of(recorded: np.ndarray, refined: np.ndarray) -> dict[str, np.ndarray]:
    return {"recorded": recorded, "refined": refined}


def noisy(seed: int, gain: float = 0.0, n: int = 160) -> dict[str, np.ndarray]:
    """Return squares (9, n) that scatter by themselves and fall by about `gain`."""
    recorded, refined = np.random.default_rng(seed).chisquare(6, (2, 9, n))
    return squares_of(recorded * np.exp(gain), refined)


@pytest.mark.parametrize("gain", [0.0, 0.1, -0.2])
@pytest.mark.parametrize("seed", range(4))
def test_gain_is_the_z_score_of_wilcoxon(seed: int, gain: float) -> None:
    from scipy.stats import wilcoxon

    # As many projections as parts of the turn: a mean over a part is the value itself.
    theta, squares = np.linspace(0, 6, 8), noisy(seed, gain, n=8)
    logarithms = np.log(squares["recorded"] / squares["refined"]).ravel()
    expected = wilcoxon(logarithms, method="approx", correction=False).zstatistic
    # Of a two-sided test scipy may tell the z score of either sign.
    assert abs(gain_sigma(squares, theta)) == pytest.approx(abs(expected))
    more = wilcoxon(logarithms, method="approx", correction=False, alternative="greater")
    assert gain_sigma(squares, theta) == pytest.approx(more.zstatistic)


def test_no_gain_scatters_as_standard_errors_do() -> None:
    theta = np.random.default_rng(0).permutation(np.linspace(0, 6, 160))
    scores = [gain_sigma(noisy(seed), theta) for seed in range(300)]
    assert abs(np.mean(scores)) < 0.2
    assert np.std(scores) == pytest.approx(1, abs=0.15)


def test_one_huge_cell_hardly_moves_the_gain() -> None:
    theta, squares = np.linspace(0, 6, 160), noisy(1, gain=0.1)
    plain = gain_sigma(squares, theta)
    for name in squares:
        huge = {key: values.copy() for key, values in squares.items()}
        huge[name][4, 20:40] *= 1e9
        # One of 72 ranks goes from one end to the other at the most.
        assert abs(gain_sigma(huge, theta) - plain) < 2 * 72 / np.sqrt(72 * 73 * 145 / 6)


def test_a_gain_turns_its_sign_when_things_get_worse() -> None:
    theta, squares = np.linspace(0, 6, 160), noisy(2, gain=0.2)
    better = gain_sigma(squares, theta)
    assert better > 3
    worse = squares_of(squares["refined"], squares["recorded"])
    assert gain_sigma(worse, theta) == pytest.approx(-better)


def test_a_gain_in_one_part_of_the_turn_only_is_no_sure_gain() -> None:
    theta = np.linspace(0, 6, 160)
    plain = noisy(3)
    first = np.arange(160) < 20
    somewhere = squares_of(plain["recorded"] * (1 + 7 * first), plain["refined"])
    everywhere = squares_of(plain["recorded"] * 8, plain["refined"])
    assert gain_sigma(everywhere, theta) == pytest.approx(best_of(72))
    rises = []
    for seed in range(20):
        squares = noisy(seed)
        there = squares_of(squares["recorded"] * (1 + 7 * first), squares["refined"])
        rises.append(gain_sigma(there, theta) - gain_sigma(squares, theta))
    assert min(rises) > 0
    assert np.mean(rises) < 2.5
    order = np.random.default_rng(1).permutation(160)
    shuffled = {name: values[:, order] for name, values in somewhere.items()}
    assert gain_sigma(shuffled, theta[order]) == pytest.approx(gain_sigma(somewhere, theta))


@pytest.mark.parametrize("value", [0.0, 2.5])
@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (6, 160)])
def test_no_difference_is_no_gain(shape: tuple[int, int], value: float) -> None:
    same = np.full(shape, value)
    assert gain_sigma(squares_of(same, same), np.linspace(0, 1, shape[1])) == 0


def test_parts_without_any_residual_say_nothing() -> None:
    theta, squares = np.linspace(0, 6, 160), noisy(2, gain=0.2)
    padded = {name: np.vstack([values, np.zeros((2, 160))]) for name, values in squares.items()}
    assert gain_sigma(padded, theta) == gain_sigma(squares, theta)
