from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tomoslam_stage.products import Pixels
from tomoslam_stage.scans import scan_of
from tomoslam_stage.simulation import SimulatedScan, recipe_from, simulate
from tomoslam_stage.tracks import Tracking
from tomoslam_stage.tracks.detectors import Keypoints, Sift
from tomoslam_stage.tracks.fixed import FixedToDetector, sectors
from tomoslam_stage.tracks.keypoints import find_keypoints

AXIS = 80.0
DUST = np.array([[20.0, 30.3], [61.4, 79.8], [100.2, 140.0]])
"""row, column; the second speck lies on the axis."""
SHAPES = {"180": np.arange(120) * 1.5, "360": np.arange(120) * 3.0, "720": np.arange(120) * 6.0}


def keypoints(place: np.ndarray) -> Keypoints:
    """Keypoints at rows and columns (k, 2)."""
    k = len(place)
    return Keypoints(place[:, 1], place[:, 0], np.full(k, 2.0), np.zeros((k, 4), np.float16))


def scanned(theta: np.ndarray, radii: np.ndarray, seen: float = 1.0) -> list[Keypoints]:
    """Dust, each speck in a share `seen` of the projections, and features that turn, one a row."""
    rng = np.random.default_rng(1)
    phase, row = rng.uniform(0, 2 * np.pi, len(radii)), np.linspace(8, 118, len(radii))
    found = []
    for angle in theta:
        turning = np.stack([row, AXIS + radii * np.cos(angle + phase)], axis=1)
        dust = (DUST + rng.normal(0, 0.15, DUST.shape))[rng.random(len(DUST)) < seen]
        scatter = rng.normal(0, 0.15, turning.shape)
        found.append(keypoints(np.concatenate([dust, turning + scatter])))
    return found


def is_dust(k: Keypoints) -> np.ndarray:
    apart = np.hypot(k.row[:, None] - DUST[:, 0], k.column[:, None] - DUST[:, 1])
    return apart.min(axis=1) < 1


@pytest.mark.parametrize("span", SHAPES)
@pytest.mark.parametrize("order", ["in order", "shuffled"])
def test_dust_is_recognised_and_what_turns_is_kept(span: str, order: str) -> None:
    theta = np.deg2rad(SHAPES[span])
    if order == "shuffled":
        theta = np.random.default_rng(3).permutation(theta)
    everything = scanned(theta, np.geomspace(4, 70, 60))
    fixed = FixedToDetector().find(everything, theta)
    for k, mask in zip(everything, fixed, strict=True):
        assert mask[is_dust(k)].all()
    turning = np.array([mask[len(DUST) :] for mask in fixed])
    assert turning.mean() < 0.03
    assert turning.mean(axis=0).max() < 0.5


def test_a_speck_seen_now_and_then_all_the_way_round_is_recognised() -> None:
    theta = np.deg2rad(SHAPES["360"])
    everything = scanned(theta, np.geomspace(4, 70, 60), seen=0.5)
    fixed = FixedToDetector().find(everything, theta)
    dust = [mask[is_dust(k)] for k, mask in zip(everything, fixed, strict=True)]
    assert 0.4 < len(np.concatenate(dust)) / (3 * 120) < 0.6
    assert np.concatenate(dust).mean() > 0.95


def test_what_stands_still_in_a_part_of_the_turn_only_is_kept() -> None:
    theta = np.deg2rad(SHAPES["360"])
    everything = scanned(theta, np.geomspace(4, 70, 60))
    late = [k if i < 60 else k.chosen(~is_dust(k)) for i, k in enumerate(everything)]
    fixed = FixedToDetector().find(late, theta)
    # On the axis, where others pass in front of it, a speck needs less to be recognised.
    beside = [
        mask[is_dust(k) & (abs(k.column - AXIS) > 5)] for k, mask in zip(late, fixed, strict=True)
    ]
    assert len(np.concatenate(beside)) >= 2 * 60
    assert not np.concatenate(beside).any()


def test_radius_says_how_far_keypoints_of_one_speck_scatter() -> None:
    rng = np.random.default_rng(4)
    theta = np.deg2rad(SHAPES["360"])
    around = [keypoints(np.array([[50.0, 60.0]]) + rng.uniform(-2.4, 2.4, (1, 2))) for _ in theta]
    narrow, wide = (
        np.concatenate(FixedToDetector(share=0.6, radius=radius).find(around, theta))
        for radius in (1, 3)
    )
    assert not narrow.any()
    assert wide.mean() > 0.9


@pytest.mark.parametrize("n", [1, 3, 7])
def test_short_scans_pass_in_silence(n: int) -> None:
    theta = np.linspace(0, 1, n)
    fixed = FixedToDetector().find(scanned(theta, np.array([10.0, 40.0])), theta)
    assert [len(mask) for mask in fixed] == [5] * n


def test_a_scan_without_keypoints_has_none_that_are_fixed() -> None:
    nothing = [keypoints(np.empty((0, 2)))] * 4
    fixed = FixedToDetector().find(nothing, np.linspace(0, 3, 4))
    assert [mask.tolist() for mask in fixed] == [[], [], [], []]


def test_sectors_are_eighths_in_the_order_of_the_angles() -> None:
    order = np.random.default_rng(5).permutation(40)
    assert sectors(np.linspace(0, 6, 40)[order]).tolist() == (order // 5).tolist()
    assert sectors(np.array([2.0, 0.0, 1.0])).tolist() == [2, 0, 1]


def test_specks_on_the_scintillator_are_left_out_of_real_keypoints(
    flat_fielded: Callable[[SimulatedScan], Pixels],
) -> None:
    recipe = recipe_from(
        {
            "phantom": {"method": "grains", "grains": 60, "seed": 5},
            "detector": {"dust": 6, "dust_depth": 0.4, "dust_shift": 1.0, "hot": 0},
            "n_projections": 64,
            "rows": 120,
            "columns": 160,
            "seed": 5,
        }
    )
    made = simulate(recipe)
    scan = scan_of(flat_fielded(made), made.theta_recorded)
    sift, usable = Sift(noise_sigmas=0.5), np.ones(recipe.rows, bool)
    found = find_keypoints(scan, sift, 4.0, usable)
    fixed = np.concatenate(FixedToDetector().find(found, scan.theta))
    place = np.concatenate([np.stack([k.row, k.column], axis=1) for k in found])
    light = made.camera.beam / made.camera.beam_before
    near = near_dust(light, place, reach=1.5)
    seen = np.bincount(near[near >= 0])
    lasting = np.flatnonzero(seen > 0.5 * len(found))
    assert len(lasting) >= 3
    assert fixed[np.isin(near, lasting)].mean() > 0.95
    # The corners of the tube's shadow and what lies on the axis stand still as well.
    from_axis = np.abs(place[:, 1] - made.axis)
    inside = (from_axis > 5) & (from_axis < 55) & (np.abs(place[:, 0] - 59.5) < 50)
    elsewhere = inside & (near_dust(light, place, reach=9) < 0)
    assert elsewhere.sum() > 1500
    assert fixed[elsewhere].mean() < 0.02
    tracks = Tracking(detector=sift).track(scan, made.axis, usable)
    assert tracks.fixed_to_detector == fixed.sum()
    assert tracks.keypoints.sum() == (~fixed).sum()


def near_dust(light: np.ndarray, place: np.ndarray, reach: float) -> np.ndarray:
    """(k,) number of the speck within `reach` px of each place (k, 2), or -1."""
    from scipy.ndimage import center_of_mass, label

    specks, count = label(light < 0.97)
    middles = np.array(center_of_mass(specks > 0, specks, range(1, count + 1)))
    apart = np.linalg.norm(place[:, None] - middles, axis=-1)
    return np.where(apart.min(axis=1) < reach, apart.argmin(axis=1), -1)
