"""The contract of every detector."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.images import noise_sigma
from tomoslam_stage.scans import scan_of
from tomoslam_stage.tracks import DETECTORS
from tomoslam_stage.tracks.detectors import Keypoints, Surf
from tomoslam_stage.tracks.keypoints import find_keypoints, stretched

SHAPE = (150, 170)
POSITION = {"sift": 0.05, "surf": 0.05}
"""px: how well the contract wants columns and rows, rms."""

every_detector = pytest.mark.parametrize("name", sorted(DETECTORS))


def places() -> np.ndarray:
    """(p, 2) rows and columns between the pixels, clear of one another and of the borders."""
    rng = np.random.default_rng(4)
    row, column = np.mgrid[40:110:20, 40:131:18].reshape(2, -1)
    return np.stack([row, column], axis=1) + rng.uniform(-0.5, 0.5, (len(row), 2))


def blobs(noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Gaussian blobs of several widths and both signs at `places`, around 0.5."""
    rng = np.random.default_rng(7)
    row, column = np.indices(SHAPE)
    image = np.full(SHAPE, 0.5)
    for y, x in places():
        squared = (row - y) ** 2 + (column - x) ** 2
        image += rng.choice([-0.4, 0.4]) * np.exp(-squared / (2 * rng.uniform(2.2, 3) ** 2))
    image += noise * np.random.default_rng(seed).normal(size=SHAPE)
    return np.clip(image, 0, 1).astype(np.float32)


def detected(name: str, image: np.ndarray) -> Keypoints:
    return DETECTORS[name]().detect(np.ascontiguousarray(image), noise_sigma(image))


def nearest(keypoints: Keypoints, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the keypoint nearest to each place, and its (row, column) from there."""
    apart = np.stack([keypoints.row, keypoints.column], axis=1)[:, None] - where
    best = np.linalg.norm(apart, axis=-1).argmin(axis=0)
    return best, apart[best, np.arange(len(where))]


@every_detector
def test_blobs_are_found_where_they_are_between_the_pixels(name: str) -> None:
    _, off = nearest(detected(name, blobs(noise=0.002)), places())
    found = np.linalg.norm(off, axis=1) < 1.5
    assert found.mean() > 0.9
    assert np.sqrt((off[found] ** 2).mean(axis=0)).max() < POSITION[name]
    assert np.abs(off[found].mean(axis=0)).max() < POSITION[name] / 2


@every_detector
@pytest.mark.parametrize("share", [0.4, 0.6])
def test_strongest_keypoints_come_first_and_as_many_as_were_asked_for(
    name: str, share: float
) -> None:
    image = blobs(noise=0.02)
    everything = detected(name, image)
    count = int(share * len(everything))
    few = DETECTORS[name](keypoints=count).detect(image, noise_sigma(image))
    assert len(few) == count > 10
    np.testing.assert_array_equal(few.row, everything.row[:count])
    np.testing.assert_array_equal(few.column, everything.column[:count])


@every_detector
def test_descriptors_have_unit_length_and_one_keypoint_stands_at_a_place(name: str) -> None:
    keypoints = detected(name, blobs(noise=0.01))
    length = np.linalg.norm(keypoints.descriptor.astype(float), axis=1)
    np.testing.assert_allclose(length, 1, atol=2e-3)
    assert keypoints.descriptor.dtype == np.float16
    seen = zip(keypoints.row, keypoints.column, keypoints.size, strict=True)
    assert len(set(seen)) == len(keypoints)


def tailed() -> np.ndarray:
    """Blobs, each with a weaker one to the right of it: they look different when turned."""
    row, column = np.indices(SHAPE)
    image = np.full(SHAPE, 0.3)
    for y, x in places().round():
        for shift, height in ((0, 0.6), (6, 0.3)):
            squared = (row - y) ** 2 + (column - x - shift) ** 2
            image += height * np.exp(-squared / (2 * 2.2**2))
    return np.clip(image, 0, 1).astype(np.float32)


@every_detector
def test_descriptors_are_upright(name: str) -> None:
    image = tailed()
    shifted = np.roll(image, (2, 4), axis=(0, 1))
    turned = np.rot90(image)
    place = places().round()
    turned_place = np.stack([SHAPE[1] - 1 - place[:, 1], place[:, 0]], axis=1)

    def described(picture: np.ndarray, where: np.ndarray) -> np.ndarray:
        keypoints = detected(name, picture)
        best, off = nearest(keypoints, where)
        assert np.median(np.linalg.norm(off, axis=1)) < 2
        return keypoints.descriptor[best].astype(float)

    there = place + np.array([2, 4])
    still = np.linalg.norm(described(image, place) - described(shifted, there), axis=1)
    moved = np.linalg.norm(described(image, place) - described(turned, turned_place), axis=1)
    assert np.median(still) < 0.1
    assert np.median(moved) > 0.35


@every_detector
def test_thresholds_adapt_to_a_scan_of_a_tenth_of_the_contrast(name: str) -> None:
    strong = 2 * (blobs(noise=0.01) - 0.5)
    everywhere = np.ones(SHAPE[0], bool)

    def found(projection: np.ndarray) -> Keypoints:
        scan = scan_of(projection[None], np.zeros(1))
        return find_keypoints(scan, DETECTORS[name](), 4.0, everywhere)[0]

    one, other = found(strong), found(strong * np.float32(0.1))
    assert len(one) > len(places())
    assert abs(len(one) - len(other)) <= 0.02 * len(one)
    _, off = nearest(one, np.stack([other.row, other.column], axis=1))
    assert (np.abs(off).max(axis=1) < 0.01).mean() > 0.98


@every_detector
def test_threshold_follows_the_noise_it_is_told(name: str) -> None:
    image = blobs(noise=0.02)
    detector = DETECTORS[name]()
    trusting, careful = detector.detect(image, 0.002), detector.detect(image, 0.05)
    assert len(places()) / 2 < len(careful) < len(trusting) / 2
    stern = DETECTORS[name](noise_sigmas=2.5 * detector.noise_sigmas).detect(image, 0.02)
    np.testing.assert_array_equal(stern.row, careful.row)


@every_detector
@pytest.mark.parametrize("shape", [(1, 1), (2, 640), (640, 2), (5, 5), (64, 80)])
def test_nothing_is_found_where_there_is_nothing(name: str, shape: tuple[int, int]) -> None:
    keypoints = DETECTORS[name]().detect(np.full(shape, 0.5, np.float32), 0.0)
    assert len(keypoints) == 0
    assert keypoints.descriptor.shape == (0, {"sift": 128, "surf": 64}[name])


@every_detector
@pytest.mark.parametrize("shape", [(1, 1), (2, 640), (640, 2), (5, 5)])
def test_projections_too_small_for_a_keypoint_pass_in_silence(
    name: str, shape: tuple[int, int]
) -> None:
    noisy = np.random.default_rng(1).normal(0, 1, (3, *shape)).astype(np.float32)
    found = find_keypoints(
        scan_of(noisy, np.arange(3.0)), DETECTORS[name](), 4.0, np.ones(shape[0], bool)
    )
    assert [len(keypoints) for keypoints in found] == [0, 0, 0]


def test_keypoints_come_from_usable_rows_only() -> None:
    usable = np.arange(SHAPE[0]) < 75
    scan = scan_of(blobs(noise=0.005)[None], np.zeros(1))
    everywhere = find_keypoints(scan, DETECTORS["sift"](), 4.0, np.ones_like(usable))[0]
    upper = find_keypoints(scan, DETECTORS["sift"](), 4.0, usable)[0]
    assert upper.row.max() < 75 < everywhere.row.max()
    assert len(upper) == (everywhere.row < 74.5).sum()


def test_stretching_puts_zero_in_the_middle_and_tells_its_factor() -> None:
    detail = np.random.default_rng(2).normal(0, 3, (60, 50)).astype(np.float32)
    image, factor = stretched(detail)
    assert image.min() >= 0
    assert image.max() <= 1
    inside = (image > 0) & (image < 1)
    assert 0.99 < inside.mean() < 1
    np.testing.assert_allclose(image[inside], 0.5 + factor * detail[inside], atol=1e-6)


def test_a_flat_projection_is_stretched_to_grey() -> None:
    image, factor = stretched(np.zeros((4, 5), np.float32))
    assert factor == 1
    assert (image == 0.5).all()


@every_detector
def test_descriptors_are_mirrored_as_the_image_is(name: str) -> None:
    there, mirrored = detected(name, blobs()), detected(name, blobs()[:, ::-1])
    back = SHAPE[1] - 1 - mirrored.column
    other, off = nearest(there, np.stack([mirrored.row, back], axis=1))
    same = (np.linalg.norm(off, axis=1) < 0.5) & (
        np.abs(np.log(there.size[other] / mirrored.size)) < 0.1
    )
    assert same.sum() > 15
    expected = DETECTORS[name]().mirrored(there.descriptor[other[same]].astype(np.float32))
    seen = mirrored.descriptor[same].astype(np.float32)
    assert np.median(np.linalg.norm(expected - seen, axis=1)) < 0.2
    turned = np.linalg.norm(there.descriptor[other[same]].astype(np.float32) - seen, axis=1)
    assert np.median(turned) > 0.4


def test_surf_is_mended_in_every_octave() -> None:
    row, column = np.indices((320, 340))
    rng = np.random.default_rng(3)
    middles = np.stack(np.meshgrid([90, 160, 230], [90, 165, 240]), axis=-1).reshape(-1, 2)
    where = middles + rng.uniform(-2, 2, middles.shape)
    widths = np.linspace(2, 10, len(where))
    image = np.full(row.shape, 0.5)
    for (y, x), width in zip(where, widths, strict=True):
        image += 0.4 * np.exp(-((row - y) ** 2 + (column - x) ** 2) / (2 * width**2))
    mended, given = (Surf(mended=way).detect(image, 0.001) for way in (True, False))

    def off(keypoints: Keypoints) -> tuple[np.ndarray, np.ndarray]:
        best, apart = nearest(keypoints, where)
        return np.linalg.norm(apart, axis=1), keypoints.size[best] / widths

    (placed, sized), (misplaced, missized) = off(mended), off(given)
    found = placed < 1.5  # mahotas itself misses some
    assert found.sum() >= 5
    assert found[widths > 5].any()
    assert placed[found].max() < 0.15
    assert np.median(misplaced[found]) > 0.3
    assert np.std(sized[found]) < 0.5 * np.std(missized[found])
