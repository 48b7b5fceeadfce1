from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Never

import numpy as np
import pytest

from tomoslam_stage.comparison import Findings, Run, report, summary, write_report
from tomoslam_stage.comparison.findings import verdict
from tomoslam_stage.comparison.plain import plain
from tomoslam_stage.comparison.writing import write_atomically
from tomoslam_stage.errors import PipelineError

FILES = {"report.html", "report.json", "logbook.png", "comparison.png", "theta.png", "theta.txt"}


def refuse_constants(name: str) -> Never:
    raise AssertionError(f"{name} is not JSON")


def read_strictly(path: Path) -> dict[str, Any]:
    made: dict[str, Any] = json.loads(path.read_text(), parse_constant=refuse_constants)
    return made


def test_all_files_are_written_into_a_new_folder_and_nothing_else(
    tmp_path: Path, findings: Findings, run: Run
) -> None:
    folder = tmp_path / "new" / "scan_tomoslam"
    made = write_report(folder, findings, run)
    assert {path.name for path in folder.iterdir()} == FILES
    assert read_strictly(folder / "report.json") == made


def test_the_report_of_accepted_angles(findings: Findings, run: Run) -> None:
    made = report(findings, run)
    change = np.degrees(findings.refinement.change)
    assert made["status"] == "accepted"
    assert made["n_projections"] == 90
    facts = {"name": "a$b$.h5", "file": None, "shape": [90, 16, 80], "binning": 1, "left_out": {}}
    assert made["scan"] == facts
    assert made["rms_change_deg"] == pytest.approx(np.sqrt(np.mean(change**2)))
    assert made["max_change_deg"] == pytest.approx(np.abs(change).max())
    assert made["median_sigma_deg"] == pytest.approx(0.02)
    assert made["axis_px"] == 39.25
    assert (made["n_features"], made["n_sightings"]) == (321, 4321)
    assert made["comparison"]["residual_gain_percent"] == pytest.approx(20)
    assert made["comparison"]["heldout_rows"] == [3, 8]
    assert made["comparison"]["errors"] == {}
    assert made["evidence"]["residual_gain_sigma"] == 7.5
    assert made["evidence"]["half_measured"] == 0.8
    assert made["seconds"] == {"load_scan": 1.25, "refine_theta": 30.5}
    assert made["versions"]["numpy"] == np.__version__
    assert made["pipeline"][0]["parameters"] == {"steps_deg": [4, 5, 10]}


def test_kept_angles_did_not_change_but_the_proposed_ones_would_have(
    findings: Findings, kept_findings: Findings, run: Run
) -> None:
    accepted, kept = report(findings, run), report(kept_findings, run)
    assert (kept["status"], kept["reason"]) == ("kept", "the halves disagree by 0.6 deg")
    assert kept["rms_change_deg"] == kept["max_change_deg"] == 0
    for key in ("proposed_rms_change_deg", "proposed_max_change_deg"):
        assert kept[key] == accepted[key] > 0


@pytest.mark.parametrize("which", ["findings", "kept_findings"])
def test_theta_txt_holds_every_digit_of_the_angles_that_stand(
    tmp_path: Path, which: str, request: pytest.FixtureRequest
) -> None:
    findings: Findings = request.getfixturevalue(which)
    write_report(tmp_path, replace(findings, reconstructions={}), Run())
    read = [float(line) for line in (tmp_path / "theta.txt").read_text().splitlines()]
    stands = "refined" if which == "findings" else "recorded"
    assert np.array_equal(read, np.degrees(getattr(findings.refinement, stands)))


def test_the_axis_is_told_in_pixels_of_the_file(findings: Findings, run: Run) -> None:
    binned = replace(findings, scan=replace(findings.scan, binning=4))
    # The centre of binned pixel 0 is the middle of the file's pixels 0 to 3.
    assert report(binned, run)["axis_px"] == 39.25 * 4 + 1.5


def test_the_axis_is_that_of_the_angles_that_stand(
    findings: Findings, kept_findings: Findings, run: Run
) -> None:
    assert report(findings, run)["axis_px"] == findings.refinement.axes["refined"]
    assert report(kept_findings, run)["axis_px"] == findings.refinement.axes["recorded"] == 38.5


def test_what_is_not_known_is_null(
    tmp_path: Path, tiny: Callable[[int], Findings], run: Run
) -> None:
    write_report(tmp_path, replace(tiny(3), reconstructions={}), run)
    made = read_strictly(tmp_path / "report.json")
    for key in ("axis_px", "median_sigma_deg", "evidence", "n_features"):
        assert made[key] is None
    assert made["comparison"]["residual_recorded"] is None
    assert made["comparison"]["residual_gain_percent"] is None


def test_truth_changes_nothing_in_the_report_but_what_is_said_about_it(
    findings: Findings, complete: Findings, run: Run
) -> None:
    blind, informed = report(findings, run), report(complete, run)
    numbers, others = informed.pop("comparison"), blind.pop("comparison")
    assert informed == blind
    assert numbers["errors"]["error_ratio"] > 1
    assert set(numbers["psnr"]) == set(numbers["ssim"]) == {"recorded", "refined"}
    assert others["errors"] == others["psnr"] == others["ssim"] == {}
    for key, value in others.items():
        if key.startswith(("residual", "heldout")):
            assert numbers[key] == value
    for name in ("recorded", "refined"):
        assert numbers["edge_width_px"][name] == others["edge_width_px"][name]


def test_an_edge_that_cannot_be_measured_is_null_in_the_report(
    findings: Findings, run: Run
) -> None:
    widths = {"recorded": np.nan, "refined": 2.5}
    made = report(
        replace(findings, comparison=replace(findings.comparison, edge_width_px=widths)), run
    )
    assert made["comparison"]["edge_width_px"] == {"recorded": None, "refined": 2.5}
    words = " ".join(summary(made).split())
    assert "width of the most changed edge unknown (recorded), 2.5 px (refined)" in words


def test_without_reconstructions_an_old_comparison_goes(
    tmp_path: Path, findings: Findings, run: Run
) -> None:
    write_report(tmp_path, findings, run)
    write_report(tmp_path, replace(findings, reconstructions={}), run)
    assert {path.name for path in tmp_path.iterdir()} == FILES - {"comparison.png"}


def test_numpy_paths_and_dataclasses_become_plain_json() -> None:
    @dataclass(frozen=True)
    class Parameters:
        rows: tuple[int, ...]
        file: Path

    value = {
        1: np.float32(0.5),
        "flag": np.bool_(True),
        "bad": [np.nan, np.inf, -np.inf, np.float32("nan")],
        "array": np.array([[1.0, np.nan]]),
        "parameters": Parameters((1, 2), Path("a/b")),
    }
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == {
        "1": 0.5,
        "flag": True,
        "bad": [None] * 4,
        "array": [[1.0, None]],
        "parameters": {"rows": [1, 2], "file": "a/b"},
    }


def test_what_json_cannot_say_is_refused_by_name() -> None:
    with pytest.raises(TypeError, match=r"cannot hold .* of type object"):
        plain({"a": [object()]})


def test_a_failed_write_leaves_the_old_file_and_no_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "report.json"
    write_atomically(path, b"old")

    def full(_: int) -> Never:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(PipelineError, match=r"report.json: 3 bytes .* \(No space left on device"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_written_files_are_as_open_as_any_other(tmp_path: Path) -> None:
    write_atomically(tmp_path / "ours", b"")
    (tmp_path / "plain").write_bytes(b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path, findings: Findings, run: Run) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(PipelineError, match=r"taken: .* --report") as refusal:
        write_report(tmp_path / "taken", findings, run)
    assert refusal.value.exit_code == 2


def test_the_verdict_names_the_change_of_the_residual(findings: Findings) -> None:
    assert verdict(findings) == (
        "refined angles accepted: reprojection residual on unused rows −20.0 %"
    )


def test_the_verdict_does_not_call_used_rows_unused(findings: Findings) -> None:
    used = replace(findings.refinement, heldout_rows=np.empty(0, np.intp))
    assert verdict(replace(findings, refinement=used)).endswith("on the rows used −20.0 %")


def test_projections_without_a_residual_are_left_out_for_both(findings: Findings) -> None:
    holed = {name: values.copy() for name, values in findings.refinement.reprojection.items()}
    holed["recorded"][:40] = np.nan
    holed["refined"][40] = 1e3
    holed["recorded"][40] = np.nan
    refinement = replace(findings.refinement, reprojection=holed)
    assert verdict(replace(findings, refinement=refinement)).endswith("−20.0 %")


def test_no_figure_of_the_slices_moves_the_verdict(findings: Findings, complete: Findings) -> None:
    assert complete.comparison != findings.comparison
    assert verdict(complete) == verdict(findings)


def test_the_summary_tells_a_scientist_what_happened(complete: Findings, run: Run) -> None:
    text = summary(report(complete, run), Path("scan_tomoslam"))
    lines = text.splitlines()
    assert lines[0] == "a$b$.h5: the refined angles are accepted"
    assert 8 <= len(lines) <= 20
    # The last one is to be pasted, and not broken.
    assert max(map(len, lines[:-1])) <= 100
    for words in (
        "90 projections; changed by",
        "0.02 deg",
        "detector column 39.25",
        "0.05 (recorded), 0.04 (refined): -20.0 % (7.5 standard errors better)",
        "px (refined); resolution by FRC of halves",
        "dB (refined); SSIM 0.9",
        "error ratio",
        "321 features, 4321 sightings",
        "scan_tomoslam: report.html, logbook.png, comparison.png, theta.png",
        "32 s: refine_theta 30.5, load_scan 1.2",
    ):
        assert words in " ".join(text.split())


def test_the_summary_of_kept_angles_says_that_nothing_changed(
    kept_findings: Findings, run: Run
) -> None:
    text = summary(report(kept_findings, run))
    assert "the recorded angles are kept, nothing was changed" in text
    assert "the halves disagree by 0.6 deg" in text
    assert "would have changed by" in text


def test_the_summary_leaves_out_what_is_not_known(tiny: Callable[[int], Findings]) -> None:
    text = summary(report(tiny(3), Run()))
    assert "no correction was found" in text
    assert "nan" not in text
    assert "None" not in text
