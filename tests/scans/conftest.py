"""Small scans, made in a moment."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage.scans import ScanContent, create_scan

N, ROWS, COLUMNS = 24, 6, 16
BEAM, DARK = 10_000, 100


@pytest.fixture
def integrals() -> np.ndarray:
    """(n, rows, columns) line integrals between 0 and 1, zero at the edges."""
    values = np.random.default_rng(5).uniform(0, 1, (N, ROWS, COLUMNS))
    values[..., :2] = values[..., -2:] = 0
    return values


@pytest.fixture
def scan_file(tmp_path: Path, integrals: np.ndarray) -> Path:
    """A simulated scan of counts over 345 degrees, with a truth."""
    counts = np.round(DARK + BEAM * np.exp(-integrals)).astype(np.uint16)
    theta = np.arange(N) * 15.0
    content = ScanContent(
        projections=iter(counts),
        flats=np.full((4, ROWS, COLUMNS), BEAM + DARK, np.uint16),
        darks=np.full((3, ROWS, COLUMNS), DARK, np.uint16),
        theta_deg=theta,
        true_theta_deg=theta + 0.1 * np.sin(np.arange(N)),
        true_axis_px=7.5,
        parameters={"phantom": "noise", "seed": 5},
    )
    path = tmp_path / "scan.h5"
    create_scan(path, content)
    return path


@pytest.fixture
def raw_scan(tmp_path: Path) -> Callable[..., Path]:
    """Write /exchange/data and theta as they are given, and any other dataset by its path."""

    def write(data: object, theta: object, units: object = "deg", **others: object) -> Path:
        path = tmp_path / "raw.h5"
        with h5py.File(path, "w") as file:
            file["/exchange/data"] = data
            file["/exchange/theta"] = theta
            if units is not None:
                file["/exchange/theta"].attrs["units"] = units
            for place, value in others.items():
                file[place.replace("__", "/")] = value
        return path

    return write
