"""Which rows are reconstructed when nobody says."""

from __future__ import annotations

import numpy as np

from tomoslam_stage.products import Refinement, Scan
from tomoslam_stage.scans import scan_of
from tomoslam_stage.stages.reconstructing import Reconstruct


def scan_with_texture(*places: slice) -> Scan:
    """Make a scan of 96 rows that shows something at `places` only."""
    n = 12
    integrals = np.zeros((n, 96, 32), np.float32)
    for place in places:
        shape = integrals[:, place].shape
        integrals[:, place] = np.random.default_rng(3).random(shape)
    return scan_of(integrals, np.linspace(0, np.pi, n, endpoint=False))


def kept(scan: Scan) -> Refinement:
    theta, axes = scan.theta, {"recorded": 15.5, "refined": 15.5}
    return Refinement(theta, theta, np.zeros_like(theta), "kept", "", axes)


def test_every_slice_shows_something_of_an_object_in_two_separate_places() -> None:
    # The middle of these rows lies between the two, where nothing is.
    scan = scan_with_texture(slice(10, 20), slice(80, 90))
    made = Reconstruct().reconstruct(scan, kept(scan))["recorded"]
    assert made.rows.tolist() == [14, 19, 84]
    assert (np.abs(made.slices).max(axis=(1, 2)) > 0).all()
