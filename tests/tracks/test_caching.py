from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.products import Scan
from tomoslam_stage.scans import scan_of
from tomoslam_stage.tracks import caching
from tomoslam_stage.tracks.detectors import Detector, Keypoints, Sift
from tomoslam_stage.tracks.keypoints import find_keypoints

N, ROWS, COLUMNS = 5, 48, 64


@pytest.fixture
def scan() -> Scan:
    rng = np.random.default_rng(7)
    return scan_of(rng.normal(0, 1, (N, ROWS, COLUMNS)).astype(np.float32), np.arange(N) / 10)


def found(scan: Scan, cache: Path | None, detector: Detector | None = None) -> list[Keypoints]:
    return find_keypoints(scan, detector or Sift(), 4.0, np.ones(ROWS, bool), cache)


def said(caplog: pytest.LogCaptureFixture) -> tuple[int, str]:
    last = caplog.records[-1]
    return last.levelno, last.getMessage().partition(": ")[2]


def assert_same(some: list[Keypoints], others: list[Keypoints]) -> None:
    for one, other in zip(some, others, strict=True):
        for name in caching.COLUMNS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
            assert getattr(one, name).dtype == getattr(other, name).dtype


@pytest.fixture(autouse=True)
def log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)


def test_keypoints_of_another_run_are_taken_to_the_last_bit(
    scan: Scan, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, first = found(scan, None), found(scan, tmp_path)
    assert said(caplog) == (logging.INFO, "keypoints 5 new")
    monkeypatch.setattr(Sift, "detect", lambda *_: pytest.fail("detected again"))
    again = found(scan, tmp_path)
    assert said(caplog) == (logging.INFO, "keypoints 5 taken")
    assert_same(plain, first)
    assert_same(plain, again)


def test_a_run_that_was_stopped_goes_on_from_what_it_had(
    scan: Scan, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    found(scan, tmp_path)
    for lost in sorted((tmp_path / "array").iterdir())[3:]:
        lost.unlink()
    assert_same(found(scan, tmp_path), found(scan, None))
    assert said(caplog) == (logging.INFO, "keypoints 3 taken, 2 new")


def test_what_was_made_from_other_pixels_parameters_or_programs_is_stale(
    scan: Scan, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    stale = logging.WARNING, "keypoints 5 stale; what was stale or corrupt was made again"
    found(scan, tmp_path)
    other = scan_of(scan.source.read(np.arange(N), np.arange(ROWS)) * 2, scan.theta)
    assert_same(found(other, tmp_path), found(other, None))
    assert said(caplog) == stale
    finer = Sift(noise_sigmas=0.4)
    assert_same(found(other, tmp_path, finer), found(other, None, finer))
    assert said(caplog) == stale
    monkeypatch.setattr(caching, "_version", lambda name: f"{name} of tomorrow")
    found(other, tmp_path, finer)
    assert said(caplog) == stale


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: content[:0],
        lambda content: content[:-1],
        lambda content: content[:30],
        lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
        lambda content: b"something else" + content,
    ],
    ids=["empty", "cut", "head only", "one bit", "another file"],
)
def test_a_corrupt_file_is_noticed_and_made_again(
    scan: Scan, tmp_path: Path, caplog: pytest.LogCaptureFixture, spoil: object
) -> None:
    found(scan, tmp_path)
    file = min((tmp_path / "array").iterdir())
    sound = file.read_bytes()
    file.write_bytes(spoil(sound))
    assert_same(found(scan, tmp_path), found(scan, None))
    level, text = said(caplog)
    assert level == logging.WARNING
    assert "1 corrupt" in text
    assert "4 taken" in text
    assert file.read_bytes() == sound


def test_a_file_that_cannot_be_kept_costs_nothing_but_the_file(
    scan: Scan, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert_same(found(scan, tmp_path), found(scan, None))
    assert "5 not kept" in said(caplog)[1]
    assert list((tmp_path / "array").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_refused(scan: Scan, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(PipelineError, match=r"cannot be made .* Choose another with --cache"):
        found(scan, tmp_path / "file")


def test_empty_projections_are_kept_as_well(tmp_path: Path) -> None:
    empty = scan_of(np.zeros((2, ROWS, COLUMNS), np.float32), np.arange(2.0))
    found(empty, tmp_path)
    assert_same(found(empty, tmp_path), found(empty, None))
