"""A scan with spoiled frames, from the file to the angles written into it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import open_scan
from tomoslam_stage.stages import Work, load_scan, write_theta

BLACK, SATURATED = (0, 20, 21, 60), 30


@pytest.fixture(scope="module")
def spoiled(
    tmp_path_factory: pytest.TempPathFactory, grains_file: Path, run: Callable[..., Work]
) -> Work:
    """A whole run on a scan of grains with a lost step before frame 45."""
    folder = tmp_path_factory.mktemp("spoiled")
    path = Path(shutil.copy(grains_file, folder / "scan.h5"))
    with h5py.File(path, "r+") as file:
        for frame in BLACK:
            file["/exchange/data"][frame] = 100
        file["/exchange/data"][SATURATED] = 65535
    work = Work(path=path, folder=folder / "report")
    return run(work, "load_scan", "refine_theta", "reconstruct", "compare", "write_theta")


def test_spoiled_frames_take_no_part(spoiled: Work) -> None:
    assert spoiled.scan is not None
    assert sorted(spoiled.scan.left_out) == [0, 20, 21, 30, 60]
    assert spoiled.refinement is not None
    assert len(spoiled.refinement.refined) == 85
    assert spoiled.refinement.status == "accepted"
    assert spoiled.reconstructions is not None
    assert len(spoiled.reconstructions["refined"].theta) == 85


def test_what_is_told_counts_the_frames_of_the_file(spoiled: Work) -> None:
    assert spoiled.report is not None
    assert [event["projection"] for event in spoiled.report["events"]] == [45]
    assert spoiled.report["n_projections"] == 85
    assert list(spoiled.report["scan"]["left_out"]) == ["0", "20", "21", "30", "60"]
    assert spoiled.report["scan"]["left_out"]["30"] == "saturated: 100% of it holds 65535"


def test_every_frame_of_the_file_has_an_angle_and_a_sigma_that_says_how_sure(spoiled: Work) -> None:
    with h5py.File(spoiled.path) as file:
        theta, sigma = file["/exchange/theta"][()], file["/exchange/theta_sigma"][()]
        true = file["/simulation/theta_true"][()]
    assert theta.shape == sigma.shape == true.shape
    assert np.isnan(sigma).nonzero()[0].tolist() == [0]
    for before, frame, after in [(19, 20, 22), (19, 21, 22), (29, 30, 31), (59, 60, 61)]:
        assert sigma[frame] > (sigma[before] + sigma[after]) / 2
    error = theta - true
    error -= np.median(error)
    measured = np.setdiff1d(np.arange(len(theta)), [*BLACK, SATURATED])
    assert np.abs(error).max() < 3 * np.abs(error[measured]).max()
    column = np.loadtxt(spoiled.folder / "theta.txt")
    np.testing.assert_allclose(column, theta, atol=1e-12)


def test_a_script_hands_on_which_frames_it_was_given(spoiled: Work, tmp_path: Path) -> None:
    projections, theta = load_scan(spoiled.path)
    assert projections.shape[0] == len(theta) == 85
    path = Path(shutil.copy(spoiled.path, tmp_path / "copy.h5"))
    write_theta(path, *projections.for_every_frame(theta + 0.01, np.full(85, 1e-3)))
    with h5py.File(path) as file:
        written, sigma = file["/exchange/theta"][()], file["/exchange/theta_sigma"][()]
        recorded = file["/exchange/theta_recorded"][()]
    np.testing.assert_allclose(written, recorded + np.degrees(0.01))
    assert np.isnan(sigma).nonzero()[0].tolist() == [0]
    shift = projections.shift_for_every_frame(np.linspace(-1, 1, 85))
    write_theta(path, *projections.for_every_frame(theta, np.full(85, 1e-3)), shift=shift)
    with h5py.File(path) as file:
        noted = file["/process/tomoslam_stage/shift_px"][()]
    assert np.isnan(noted).nonzero()[0].tolist() == [0, 20, 21, 30, 60]
    with pytest.raises(ScanError, match=r"\(85,\) refined angles .* for 90 projections"):
        write_theta(path, theta)


def test_another_run_starts_from_all_recorded_angles(spoiled: Work, grains_file: Path) -> None:
    again, first = open_scan(spoiled.path), open_scan(grains_file)
    assert again.theta_of_frames is not None
    np.testing.assert_array_equal(again.theta_of_frames, first.theta)
