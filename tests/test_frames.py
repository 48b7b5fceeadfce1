from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.frames import of_all_frames, shift_in_file
from tomoslam_stage.products import Scan, StageNoise
from tomoslam_stage.scans import ArraySource, only

RECORDED = np.radians(np.arange(10) * 2.0)


def scan_of_frames(frames: list[int], recorded: np.ndarray = RECORDED) -> Scan:
    return Scan(
        ArraySource(np.zeros((len(frames), 2, 8), np.float32)),
        recorded[frames],
        np.array(frames),
        theta_of_frames=recorded,
    )


def test_angles_stay_as_they_are_where_every_frame_is_used() -> None:
    scan = Scan(ArraySource(np.zeros((10, 2, 8), np.float32)), RECORDED, np.arange(10))
    sigma = np.full(10, 0.1)
    theta, spread = of_all_frames(scan, RECORDED + 0.1, sigma)
    np.testing.assert_array_equal(theta, RECORDED + 0.1)
    assert spread is sigma


def test_a_frame_left_out_gets_its_recorded_angle_corrected_as_around() -> None:
    frames = [0, 1, 2, 5, 6, 7, 8, 9]
    scan = scan_of_frames(frames)
    correction = np.array(frames) * 0.01
    theta, _ = of_all_frames(scan, scan.theta + correction, np.full(8, 0.1))
    np.testing.assert_allclose(theta, RECORDED + np.arange(10) * 0.01)
    np.testing.assert_array_equal(theta[frames], scan.theta + correction)


def test_it_is_as_unsure_as_a_walk_held_at_both_ends() -> None:
    frames = [0, 4, 5, 6, 7, 8, 9]
    scan, sigma = scan_of_frames(frames), np.full(7, 0.1)
    _, spread = of_all_frames(scan, scan.theta, sigma, StageNoise(0.2, 0.3))
    walk = 0.2**2 * np.array([0.75, 1.0, 0.75])
    np.testing.assert_allclose(spread[1:4], np.sqrt(0.1**2 + walk + 0.3**2))
    np.testing.assert_array_equal(spread[frames], sigma)


def test_without_a_noise_of_the_stage_its_corrections_tell_how_unsure() -> None:
    frames = [0, 1, 2, 3, 4, 6, 7, 8, 9]
    scan, sigma = scan_of_frames(frames), np.full(9, 1e-3)
    correction = np.cumsum(np.random.default_rng(1).normal(0, 0.2, 9))
    _, calm = of_all_frames(scan, scan.theta, sigma)
    _, restless = of_all_frames(scan, scan.theta + correction, sigma)
    assert calm[5] == pytest.approx(1e-3)
    assert 0.05 < restless[5] < 0.4


def test_nobody_knows_sigma_beyond_what_was_measured_or_recorded() -> None:
    recorded = np.where(np.arange(10) == 5, np.nan, RECORDED)
    scan = scan_of_frames([1, 2, 3, 4, 6, 7, 8], recorded)
    theta, spread = of_all_frames(scan, scan.theta + 0.02, np.full(7, 0.1))
    np.testing.assert_allclose(theta, RECORDED + 0.02)
    assert np.isnan(spread).nonzero()[0].tolist() == [0, 5, 9]


def test_shifts_are_told_in_px_of_the_file_and_not_for_frames_left_out() -> None:
    shift = np.array([0.5, -1.0, 0.25])
    some = replace(scan_of_frames([0, 3, 9]), binning=2)
    told = shift_in_file(some, shift)
    assert told.shape == (10,)
    np.testing.assert_array_equal(told[[0, 3, 9]], 2 * shift)
    assert np.isnan(told).sum() == 7
    every = replace(some, theta_of_frames=None)
    np.testing.assert_array_equal(shift_in_file(every, shift), 2 * shift)


def test_the_stage_steps_on_while_frames_are_left_out_but_not_for_flats() -> None:
    every = np.deg2rad([0.0, 1, 2, 3, np.nan, np.nan, 4, 5])
    scan = scan_of_frames([0, 1, 3, 6], every)
    np.testing.assert_array_equal(scan.stage_steps, [1, 2, 1])
    whole = replace(scan, theta_of_frames=None)
    np.testing.assert_array_equal(whole.stage_steps, [1, 1, 1])
    some, all_of_them = np.array([0, 2, 3]), replace(whole, frames=np.arange(4))
    np.testing.assert_array_equal(only(scan, some).stage_steps, [3, 1])
    np.testing.assert_array_equal(only(all_of_them, some).stage_steps, [2, 1])
