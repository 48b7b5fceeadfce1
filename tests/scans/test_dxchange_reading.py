from __future__ import annotations

import hashlib
import logging
import os
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.scans import (
    ArraySource,
    BinnedSource,
    ScanContent,
    create_scan,
    describe_scan,
    open_scan,
    read_truth,
    selection,
)


def everything(scan):
    return scan.source.read(np.arange(scan.n_projections), np.arange(scan.n_rows))


def test_counts_become_the_line_integrals_they_were_made_from(scan_file, integrals):
    scan = open_scan(scan_file)
    # rounding to whole counts of 3679 or more moves an integral by at most 0.5 / 3679
    np.testing.assert_allclose(everything(scan), integrals, atol=1.5e-4)
    np.testing.assert_allclose(np.degrees(scan.theta), np.arange(24) * 15.0)
    assert scan.frames.tolist() == list(range(24))


def test_opening_and_reading_leave_the_file_and_its_modification_time_alone(scan_file):
    os.utime(scan_file, ns=(10**18, 10**18))
    before = hashlib.sha256(scan_file.read_bytes()).digest()
    everything(open_scan(scan_file))
    describe_scan(scan_file)
    assert scan_file.stat().st_mtime_ns == 10**18
    assert hashlib.sha256(scan_file.read_bytes()).digest() == before
    assert [p.name for p in scan_file.parent.iterdir()] == [scan_file.name]


@pytest.mark.parametrize("block", [1, 300, 1 << 22])
@pytest.mark.parametrize(
    ("projections", "rows"),
    [([7], [3]), ([5, 2, 2, 23, 0], [4, 0, 4]), (range(0, 24, 5), [5]), ([], [1]), ([3], [])],
)
def test_any_order_of_projections_and_rows_reads_the_same_pixels(
    scan_file, monkeypatch, block, projections, rows
):
    scan = open_scan(scan_file)
    whole = everything(scan)
    monkeypatch.setattr(selection, "BLOCK_PIXELS", block)
    p, r = np.array(projections, np.intp), np.array(rows, np.intp)
    np.testing.assert_array_equal(scan.source.read(p, r), whole[np.ix_(p, r)])


def test_reading_outside_the_scan_is_an_index_error(scan_file):
    with pytest.raises(IndexError, match="projections 24 to 24 of 24"):
        open_scan(scan_file).source.read(np.array([24]), np.array([0]))


def test_no_read_holds_more_than_a_block_of_the_file(monkeypatch):
    class Watched:
        shape, chunks = (500, 40, 30), (1, 40, 30)
        largest = 0

        def __getitem__(self, key):
            size = np.prod([s.stop - s.start for s in key[:2]]) * 30
            Watched.largest = max(Watched.largest, int(size))
            return np.zeros((key[0].stop - key[0].start, key[1].stop - key[1].start, 30))

    monkeypatch.setattr(selection, "BLOCK_PIXELS", 6000)
    ArraySource(Watched()).read(np.arange(500), np.array([0, 20, 39]))
    assert 0 < Watched.largest <= 6000


def test_threads_may_read_at_once(scan_file):
    scan = open_scan(scan_file)
    whole = everything(scan)
    with ThreadPoolExecutor(4) as pool:
        read = list(pool.map(scan.projection, list(range(24)) * 4))
    np.testing.assert_array_equal(np.stack(read), np.concatenate([whole] * 4))


def test_binning_averages_squares_of_pixels_and_drops_the_remainder(scan_file):
    fine = everything(open_scan(scan_file))
    scan = open_scan(scan_file, binning=5)
    assert scan.source.shape == (24, 1, 3)
    assert scan.binning == 5
    expected = fine[:, :5, :15].reshape(24, 1, 5, 3, 5).mean((2, 4))
    np.testing.assert_allclose(everything(scan), expected, rtol=1e-5, atol=1e-6)


def test_binning_reads_rows_in_the_order_asked_for(integrals):
    source = BinnedSource(ArraySource(integrals), 2)
    whole = source.read(np.arange(24), np.arange(3))
    np.testing.assert_array_equal(
        source.read(np.array([4, 1]), np.array([2, 0])), whole[[4, 1]][:, [2, 0]]
    )


@pytest.mark.parametrize("factor", [0, 7])
def test_binning_beyond_the_detector_is_refused(scan_file, factor):
    with pytest.raises(PipelineError, match=f"binning: {factor} for projections of 6 x 16 px"):
        open_scan(scan_file, binning=factor)


def test_flats_before_and_after_are_interpolated_along_the_scan(tmp_path):
    n = 11
    beam = np.linspace(1000, 2000, n)
    shape = (4, 16)
    content = ScanContent(
        projections=[np.full(shape, round(b), np.uint16) for b in beam],
        flats=np.stack([np.full(shape, c, np.uint16) for c in (1000, 1000, 2000)]),
        darks=np.zeros((1, *shape), np.uint16),
        theta_deg=np.arange(n) * 15.0,
        flats_after=1,
    )
    create_scan(tmp_path / "s.h5", content)
    read = everything(open_scan(tmp_path / "s.h5"))
    # flats lie at 0 and 11 projections; projection i at i of 11, its beam at i of 10
    expected = -np.log(np.round(beam) / (1000 + 1000 * np.arange(n) / n))
    np.testing.assert_allclose(read[:, 0, 0], expected, atol=1e-5)
    assert describe_scan(tmp_path / "s.h5")["flat_groups"] == 2


def test_flat_field_mode_both_splits_the_flats_in_halves(raw_scan):
    data = np.full((10, 2, 8), 100.0)
    flats = np.repeat([100.0, 200.0], 2)[:, None, None] * np.ones((1, 2, 8))
    path = raw_scan(
        data,
        np.arange(10) * 18.0,
        exchange__data_white=flats,
        process__acquisition__flat_fields__flat_field_mode=b"Both",
    )
    np.testing.assert_allclose(
        everything(open_scan(path))[:, 1, 3], np.log(1 + np.arange(10) / 10), atol=1e-6
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0, -5.0])
def test_bad_pixels_never_leave_the_reader(raw_scan, bad):
    data = np.full((8, 3, 12), 500.0)
    data[2, 1, 4] = bad
    data[3] = bad
    flats = np.full((2, 3, 12), 1000.0)
    flats[:, 0, 7] = 0
    path = raw_scan(data, np.arange(8) * 20.0, exchange__data_white=flats)
    read = everything(open_scan(path))
    assert np.isfinite(read).all()
    np.testing.assert_allclose(read[0], np.log(2), rtol=1e-6)
    if not np.isfinite(bad):
        np.testing.assert_allclose(read[2], np.log(2), rtol=1e-6)


def test_gaps_are_filled_by_interpolation_along_the_row():
    line = np.array([[np.nan, 1, np.nan, np.nan, 4, np.nan], [np.nan] * 6], np.float32)
    assert selection.filled(line).tolist() == [[1, 1, 2, 3, 4, 4], [0] * 6]


def test_one_bad_flat_among_five_leaves_no_mark(raw_scan):
    flats = np.full((5, 2, 8), 1000.0)
    flats[3] = 0
    path = raw_scan(np.full((8, 2, 8), 500.0), np.arange(8) * 20.0, exchange__data_white=flats)
    np.testing.assert_allclose(everything(open_scan(path)), np.log(2), rtol=1e-6)


def absorbing_block(air, inside):
    data = np.full((8, 4, 64), air)
    data[:, :, 16:48] = inside
    return data


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (absorbing_block(0.7, 0.2), "transmission"),
        (absorbing_block(0.01, 0.6), "line_integrals"),
        (absorbing_block(-0.02, 3.0), "line_integrals"),
    ],
)
def test_kind_is_decided_by_the_values_and_logged(raw_scan, caplog, data, kind):
    path = raw_scan(data, np.arange(8) * 20.0)
    with caplog.at_level(logging.INFO, "tomoslam_stage"):
        read = everything(open_scan(path))
    assert f"taken as {kind.replace('_', ' ')}: there are no flats" in caplog.text
    expected = data if kind == "line_integrals" else -np.log(data / 0.7)
    np.testing.assert_allclose(read, expected, atol=1e-6)
    assert describe_scan(path)["kind"] == kind


def test_kind_can_be_overridden(raw_scan):
    path = raw_scan(absorbing_block(0.7, 0.2), np.arange(8) * 20.0)
    np.testing.assert_allclose(
        everything(open_scan(path, kind="line_integrals")), absorbing_block(0.7, 0.2), rtol=1e-6
    )
    with pytest.raises(ScanError, match=r"counts need flats, and /exchange/data_white is missing"):
        open_scan(path, kind="counts")


def test_big_endian_and_half_precision_data_are_read(raw_scan):
    for dtype in (">f4", "<f2", ">u2"):
        path = raw_scan(absorbing_block(2, 1).astype(dtype), np.arange(8) * 20.0)
        read = everything(open_scan(path, kind="line_integrals"))
        np.testing.assert_array_equal(read, absorbing_block(2, 1))


def test_truth_is_read_apart_from_the_scan(scan_file, raw_scan):
    truth = read_truth(scan_file)
    assert truth is not None
    assert truth.axis == 7.5
    expected = np.arange(24) * 15 + 0.1 * np.sin(np.arange(24))
    np.testing.assert_allclose(np.degrees(truth.theta), expected)
    assert read_truth(raw_scan(np.ones((8, 2, 8)), np.arange(8.0))) is None


def test_a_scan_with_too_few_projections_is_not_created(tmp_path):
    frame = np.ones((2, 8), np.uint16)
    content = ScanContent([frame] * 3, frame[None], frame[None], np.arange(4.0))
    with pytest.raises(ScanError, match=r"s\.h5: 3 projections for 4 angles"):
        create_scan(tmp_path / "s.h5", content)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("scan_file")
def test_virtual_projections_are_read_like_any_others(tmp_path, integrals):
    layout = h5py.VirtualLayout((24, 6, 16), np.uint16)
    layout[:] = h5py.VirtualSource("scan.h5", "/exchange/data", (24, 6, 16))
    path = tmp_path / "virtual.h5"
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("/exchange/data", layout)
        for name in ("theta", "data_white", "data_dark"):
            file[f"/exchange/{name}"] = h5py.ExternalLink("scan.h5", f"/exchange/{name}")
    np.testing.assert_allclose(everything(open_scan(path)), integrals, atol=1.5e-4)
