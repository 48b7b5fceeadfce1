"""Real scans, and scans of real objects, where they lie beside the checkout."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tomoslam_stage.scans import ProcessRecord, describe_scan, open_scan, read_truth, write_theta

SCANS = Path(__file__).parents[3] / "shared" / "scans"
EXPECTED = {
    "bone_walk_360.h5": ("counts", (360, 128, 345), 359.0, True),
    "shell_lost_180.h5": ("counts", (361, 225, 129), 180.0, True),
    "savu_24737.h5": ("transmission", (91, 135, 160), 180.0, False),
    "tooth_2rows.h5": ("counts", (181, 2, 640), 179.0055, False),
}


@pytest.fixture(params=EXPECTED)
def shared(request):
    if not SCANS.is_dir():
        pytest.skip(f"the shared scans are not there: {SCANS} is missing")
    return SCANS / request.param


def test_shared_scan_is_read_as_what_it_is(shared):
    kind, shape, span, simulated = EXPECTED[shared.name]
    facts = describe_scan(shared)
    assert (facts["kind"], tuple(facts["shape"]), facts["problems"]) == (kind, shape, [])
    assert facts["span_deg"] == pytest.approx(span, abs=1e-3)
    assert (read_truth(shared) is not None) == simulated


def test_shared_scan_gives_line_integrals_with_air_at_zero(shared):
    scan = open_scan(shared)
    few = np.linspace(0, scan.n_projections - 1, 5).astype(np.intp)
    read = scan.source.read(few, np.arange(0, scan.n_rows, 8))
    assert np.isfinite(read).all()
    edges = np.concatenate([read[..., :3], read[..., -3:]], axis=-1)
    assert abs(np.median(edges)) < 0.05
    assert np.percentile(read, 99) > 0.5


def test_shared_scan_keeps_its_pixels_when_angles_are_written(shared, tmp_path):
    path = Path(shutil.copyfile(shared, tmp_path / shared.name))
    scan = open_scan(path)
    rows = np.array([0, scan.n_rows - 1])
    before = scan.sinograms(rows)
    write_theta(path, scan.theta + 1e-3, np.full(scan.n_projections, 1e-4), ProcessRecord())
    again = open_scan(path)
    np.testing.assert_array_equal(again.sinograms(rows), before)
    np.testing.assert_array_equal(again.theta, scan.theta)
