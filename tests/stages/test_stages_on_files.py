"""The stages of a run, one after the other, on scans in files."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from tomoslam_stage import pipeline, refine_theta
from tomoslam_stage.comparison import wholes
from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.products import Tracks
from tomoslam_stage.scans import open_scan, revert
from tomoslam_stage.stages import MODULES, STAGES, Work
from tomoslam_stage.stages.reconstructing import turned_to
from tomoslam_stage.stages.refining import tracks_in
from tomoslam_stage.stages.work import Clock

LONG_AGO = 1_500_000_000


def left(path: Path) -> tuple[str, int]:
    """What tells whether anybody wrote to a file: its digest and its time."""
    return hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns


def aged(path: Path) -> tuple[str, int]:
    os.utime(path, (LONG_AGO, LONG_AGO))
    return left(path)


def read(path: Path, place: str) -> np.ndarray:
    with h5py.File(path) as file:
        return file[place][()]


def table_rows(path: Path) -> int:
    return len(read(path, "/process/table/actor"))


def test_file_and_array_give_the_same_answer(
    tmp_path: Path, grains, integrals: np.ndarray, run
) -> None:
    path = tmp_path / "integrals.h5"
    with h5py.File(path, "w") as file:
        file["/exchange/data"] = integrals
        file["/exchange/theta"] = np.rad2deg(grains.theta_recorded)
    work = Work(path=path, folder=tmp_path, dry_run=True)
    run(work, "load_scan", kind="line_integrals")
    run(work, "refine_theta")
    np.testing.assert_allclose(work.scan.theta, grains.theta_recorded, atol=1e-14)
    # Degrees of a file do not become the very bits that were radians before.
    refined = refine_theta(integrals, work.scan.theta)
    for name in ("refined", "sigma"):
        np.testing.assert_array_equal(getattr(work.refinement, name), getattr(refined, name))
    assert work.refinement.axes == refined.axes
    assert work.refinement.evidence == refined.evidence
    assert work.refinement.status == refined.status == "accepted"
    assert {"axis", "tracks", "features", "map", "graph", "gate"} <= set(work.seconds)


def test_accepted_angles_are_written_and_the_recorded_ones_kept(accepted: Work, run) -> None:
    recorded = read(accepted.path, "/exchange/theta")
    raw = read(accepted.path, "/exchange/data")
    aged(accepted.path)
    run(accepted, "write_theta")
    assert accepted.path.stat().st_mtime > LONG_AGO
    theta = read(accepted.path, "/exchange/theta")
    np.testing.assert_array_equal(theta, np.rad2deg(accepted.refinement.refined))
    np.testing.assert_array_equal(read(accepted.path, "/exchange/theta_recorded"), recorded)
    np.testing.assert_array_equal(
        read(accepted.path, "/exchange/theta_sigma"), np.rad2deg(accepted.refinement.sigma)
    )
    np.testing.assert_array_equal(read(accepted.path, "/exchange/data"), raw)
    assert table_rows(accepted.path) == 1
    message = read(accepted.path, "/process/table/message")[0].decode()
    assert message == accepted.refinement.reason


def test_refining_leaves_the_tracks_that_gave_the_angles(done: Work) -> None:
    tracks = done.tracks
    assert tracks.n_sightings == done.refinement.counts["sightings"]
    assert tracks.n_features == done.refinement.counts["features"]
    residuals = done.refinement.histograms["sighting_residuals"]
    assert residuals.shape == tracks.feature.shape
    assert tracks.column.max() < done.scan.n_columns


def test_tracks_of_binned_projections_are_told_in_px_of_the_scan(done: Work) -> None:
    small = replace(done.scan, binning=4)
    place = np.array([0.0, 10.0])
    none = np.empty(0, np.intp)
    tracks = Tracks(np.array([0, 1]), np.array([3, 4]), place, place, none)
    told = tracks_in(done.scan, small, tracks)
    # The centre of the first binned pixel lies between pixels 1 and 2.
    assert told.column.tolist() == told.row.tolist() == [1.5, 41.5]
    np.testing.assert_array_equal(tracks_in(small, small, tracks).column, place)


def test_a_second_run_gives_the_same_angles_and_one_more_row(accepted: Work, run) -> None:
    names = [f"/exchange/theta{ending}" for ending in ("", "_recorded", "_sigma")]
    run(accepted, "write_theta")
    first = [read(accepted.path, name) for name in names]
    again = Work(path=accepted.path, folder=accepted.folder)
    run(again, "load_scan", "refine_theta")
    run(again, "write_theta")
    np.testing.assert_array_equal(again.refinement.recorded, accepted.refinement.recorded)
    for name, before in zip(names, first, strict=True):
        assert read(accepted.path, name).tobytes() == before.tobytes()
    assert table_rows(accepted.path) == 2


def test_revert_restores_the_recorded_angles(accepted: Work, run) -> None:
    recorded = read(accepted.path, "/exchange/theta")
    run(accepted, "write_theta")
    assert not np.array_equal(read(accepted.path, "/exchange/theta"), recorded)
    revert(accepted.path)
    assert read(accepted.path, "/exchange/theta").tobytes() == recorded.tobytes()
    with h5py.File(accepted.path) as file:
        assert not {"theta_recorded", "theta_sigma"} & set(file["/exchange"])


def test_output_leaves_the_scan_untouched_and_holds_the_angles(accepted: Work, run) -> None:
    before = aged(accepted.path)
    output = accepted.path.with_name("refined.h5")
    run(replace(accepted, output=output), "write_theta")
    assert left(accepted.path) == before
    np.testing.assert_array_equal(
        read(output, "/exchange/theta"), np.rad2deg(accepted.refinement.refined)
    )
    np.testing.assert_array_equal(
        read(output, "/exchange/data"), read(accepted.path, "/exchange/data")
    )
    np.testing.assert_array_equal(open_scan(output).theta, open_scan(accepted.path).theta)


@pytest.mark.parametrize("output", [False, True])
def test_a_dry_run_writes_no_angles_anywhere(accepted: Work, run, output: bool) -> None:
    before = aged(accepted.path)
    there = set(accepted.path.parent.iterdir())
    companion = accepted.path.with_name("refined.h5") if output else None
    run(replace(accepted, dry_run=True, output=companion), "write_theta")
    assert left(accepted.path) == before
    assert set(accepted.path.parent.iterdir()) == there


@pytest.mark.parametrize("output", [False, True])
def test_a_kept_scan_keeps_every_byte_and_its_time(
    smooth_file: Path, run, tmp_path: Path, output: bool
) -> None:
    path = Path(shutil.copy(smooth_file, tmp_path / "scan.h5"))
    before = aged(path)
    companion = tmp_path / "refined.h5" if output else None
    work = Work(path=path, folder=tmp_path / "report", output=companion)
    run(work, "load_scan", "refine_theta", axis=65.5, mapping=None)
    run(work, "write_theta")
    assert work.refinement.status == "kept"
    assert left(path) == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("truth", ["scrambled", "deleted"])
def test_true_angles_in_the_file_change_no_bit_of_the_refined_ones(
    accepted: Work, run, truth: str
) -> None:
    with h5py.File(accepted.path, "r+") as file:
        if truth == "deleted":
            del file["/simulation"]
        else:
            n = len(file["/simulation/theta_true"])
            file["/simulation/theta_true"][...] = np.random.default_rng(0).uniform(0, 360, n)
            file["/simulation/axis_px"][...] = 3.0
            file["/simulation/parameters"][...] = "{}"
    again = Work(path=accepted.path, folder=accepted.folder)
    run(again, "load_scan", "refine_theta")
    for name in ("refined", "sigma", "recorded"):
        one, other = (getattr(work.refinement, name) for work in (again, accepted))
        assert one.tobytes() == other.tobytes()
    assert again.refinement.evidence == accepted.refinement.evidence
    assert again.refinement.axes == accepted.refinement.axes
    assert again.refinement.reason == accepted.refinement.reason


def test_true_angles_are_told_in_the_errors_of_the_report_alone(accepted: Work, run) -> None:
    with_truth = run(accepted, "reconstruct", "compare")
    assert set(wholes(with_truth.reconstructions)) == {"recorded", "refined", "true"}
    errors = with_truth.report["comparison"]["errors"]
    assert errors
    assert json.loads((accepted.folder / "report.json").read_text())["status"] == "accepted"
    assert {"report.json", "theta.txt", "slices.h5"} <= {p.name for p in accepted.folder.iterdir()}
    with h5py.File(accepted.folder / "slices.h5") as file:
        assert set(file) == {"recorded", "refined", "true"}
    with h5py.File(accepted.path, "r+") as file:
        del file["/simulation"]
    without = replace(accepted, folder=accepted.folder.with_name("other"))
    run(without, "reconstruct", "compare")
    assert set(wholes(without.reconstructions)) == {"recorded", "refined"}
    assert not without.report["comparison"]["errors"]
    for name in ("status", "reason", "evidence", "axis_px", "median_sigma_deg", "counts"):
        assert without.report[name] == with_truth.report[name]
    for name in ("recorded", "refined"):
        np.testing.assert_array_equal(
            without.reconstructions[name].slices, with_truth.reconstructions[name].slices
        )


def test_each_set_of_angles_is_reconstructed_with_its_own_axis(accepted: Work, run) -> None:
    run(accepted, "reconstruct", rows=(30, 40, 40), backend="embedded")
    made, found = accepted.reconstructions, accepted.refinement
    for name in ("recorded", "refined"):
        assert made[name].axis == found.axes[name]
        assert made[name].rows.tolist() == [30, 40]
        assert made[name].slices.shape == (2, 128, 128)
        assert made[name].method == "embedded fbp"
    np.testing.assert_array_equal(made["recorded"].theta, found.recorded)
    np.testing.assert_allclose(np.diff(made["refined"].theta), np.diff(found.refined), atol=1e-12)
    assert abs(np.mean(made["refined"].theta - found.recorded)) < 1e-12
    assert abs(np.mean(found.change)) > 1e-4


def test_a_common_angle_is_taken_off() -> None:
    theta = np.array([0.0, 0.1, 0.3])
    np.testing.assert_allclose(turned_to(theta, theta + 0.7), theta, atol=1e-15)


@pytest.mark.parametrize("rows", [(96,), (3, 900), ()])
def test_rows_that_are_not_there_are_refused(accepted: Work, run, rows: tuple[int, ...]) -> None:
    with pytest.raises(PipelineError, match=r"rows between 0 and 95 are needed for grains"):
        run(accepted, "reconstruct", rows=rows)


def test_what_stands_in_the_way_of_writing_is_said_before_any_work(
    grains_file: Path, tmp_path: Path
) -> None:
    path = Path(shutil.copy(grains_file, tmp_path / "scan.h5"))
    path.with_name("other.h5").hardlink_to(path)  # so that it is edited in place
    (tmp_path / "taken.h5").write_text("years of work")
    work = Work(path=path, folder=tmp_path)
    with h5py.File(path, "r"):
        with pytest.raises(ScanError, match="another program has it open"):
            pipeline.run(pipeline.load_pipeline("default"), work, MODULES)
        assert work.scan is not None
        assert work.refinement is None
        write = STAGES["write_theta"]()
        for harmless in ({"dry_run": True}, {"output": tmp_path / "out.h5"}):
            write.check_writable(Work(path=path, folder=tmp_path, **harmless))
        with pytest.raises(ScanError, match="it exists, and is not an earlier output"):
            write.check_writable(Work(path=path, folder=tmp_path, output=tmp_path / "taken.h5"))


def test_loading_tells_the_shape_and_bins_where_asked(grains_file: Path, tmp_path: Path) -> None:
    work = Work(path=grains_file, folder=tmp_path, dry_run=True)
    told = STAGES["load_scan"](binning=2).run(work)
    assert told == {"n_projections": 90, "n_rows": 48, "n_columns": 64}
    assert work.scan.binning == 2


def test_refining_tells_its_status_and_axis(smooth_file: Path, tmp_path: Path, run) -> None:
    work = run(Work(path=smooth_file, folder=tmp_path, dry_run=True), "load_scan")
    told = STAGES["refine_theta"](axis=65.5, mapping=None).run(work)
    assert told == {"status": "kept", "axis": 65.5}


@pytest.mark.parametrize(
    ("stage", "missing"),
    [
        ("refine_theta", "scan"),
        ("reconstruct", "scan"),
        ("compare", "scan"),
        ("write_theta", "scan"),
    ],
)
def test_a_stage_without_what_it_needs_is_refused(
    tmp_path: Path, run, stage: str, missing: str
) -> None:
    with pytest.raises(PipelineError, match=f"pipeline: no entry made the {missing}"):
        run(Work(path=tmp_path / "none.h5", folder=tmp_path), stage)


def test_stages_need_and_make_products_that_a_run_has_room_for() -> None:
    room = {field.name for field in fields(Work)}
    for stage in STAGES.values():
        assert {*getattr(stage, "needs", ()), *getattr(stage, "makes", ())} <= room


def test_a_clock_adds_up_the_seconds_of_a_station() -> None:
    seconds = {"tracks": 5.0}
    clock = Clock(seconds)
    with clock("tracks"), clock("angles"):
        pass
    assert 5 < seconds["tracks"] < 6
    assert 0 < seconds["angles"] < 1
