"""The stages as plain functions: arrays in, arrays out."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage import compare, load_scan, reconstruct, write_theta
from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.products import Refinement


def test_a_loaded_scan_is_read_where_it_is_sliced(grains_file: Path) -> None:
    projections, theta = load_scan(grains_file)
    everything = np.asarray(projections)
    assert projections.shape == everything.shape == (90, 96, 128)
    assert len(projections) == len(theta) == 90
    assert everything.dtype == projections.dtype == np.float32
    np.testing.assert_array_equal(projections[3], everything[3])
    np.testing.assert_array_equal(projections[2:9:3, 5], everything[2:9:3, 5])
    np.testing.assert_array_equal(projections[-1, [4, 2], 7:9], everything[-1, [4, 2], 7:9])
    np.testing.assert_array_equal(projections[..., 7], everything[..., 7])
    assert projections[4, 5, 6] == everything[4, 5, 6]


def test_slices_of_a_script_are_those_of_a_pipeline_and_compare(
    integrals: np.ndarray, refined: Refinement
) -> None:
    axis = refined.axes["refined"]
    made = reconstruct(integrals, refined.refined, axis, rows=[40, 60], backend="embedded")
    worse = reconstruct(integrals, refined.recorded, axis, rows=[40, 60], backend="embedded")
    assert made.shape == (2, 128, 128)
    assert made.dtype == np.float32
    found = compare(worse, made, true=made)
    assert found.similarity["ssim"]["recorded"] < found.similarity["ssim"]["refined"] == 1
    with pytest.raises(ValueError, match="same rows and size"):
        compare(worse, made[:, 1:])


def test_written_angles_are_in_the_scan_or_in_the_companion_alone(
    grains_file: Path, tmp_path: Path
) -> None:
    grains_file = Path(shutil.copy(grains_file, tmp_path))
    theta = np.linspace(0, 3, 90)
    before = grains_file.read_bytes()
    write_theta(grains_file, theta, output=tmp_path / "companion.h5")
    assert grains_file.read_bytes() == before
    write_theta(grains_file, theta, np.full(90, 0.01))
    for path in (grains_file, tmp_path / "companion.h5"):
        with h5py.File(path) as file:
            np.testing.assert_allclose(file["exchange/theta"][:], np.degrees(theta))
    with pytest.raises(ScanError):
        write_theta(grains_file, theta[:-1])


def test_a_wrong_parameter_is_answered_with_the_nearest(integrals: np.ndarray) -> None:
    with pytest.raises(PipelineError, match="Did you mean 'rows'"):
        reconstruct(integrals, np.linspace(0, 3, 90), 60.0, row=[1])
