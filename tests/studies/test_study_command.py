"""``study``: one command for each published experiment."""

from __future__ import annotations

import csv
import re
import shutil
from base64 import b64decode
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tomoslam_stage.cli import main
from tomoslam_stage.comparison.plain import plain
from tomoslam_stage.studies import STUDIES, given

PNG = b"\x89PNG\r\n\x1a\n"

every_study = pytest.mark.parametrize("name", STUDIES)


@every_study
def test_each_study_leaves_a_picture_numbers_and_a_conclusion(everything: Any, name: str) -> None:
    assert everything.code == 0, everything.err
    assert (everything.folder / f"{name}.png").read_bytes().startswith(PNG)
    facts = everything.facts(name)
    assert f"{name}: {facts['conclusion']}" in everything.out
    with (everything.folder / f"{name}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(facts["table"]) > 1
    assert "seed 0" in facts["case"]
    assert facts["parameters"] == plain(STUDIES[name](**STUDIES[name].fast))


def test_the_page_holds_everything_in_one_file(everything: Any) -> None:
    page = (everything.folder / "index.html").read_text()
    pictures = [b64decode(found) for found in re.findall(r"base64,([\w+/=]+)", page)]
    names = list(STUDIES)
    assert pictures == [(everything.folder / f"{name}.png").read_bytes() for name in names]
    sources = re.findall(r'(?:src|href)="(.{5})', page)
    assert set(sources) == {"data:"}
    assert re.findall(r'<h2 id="([\w-]+)"', page) == names


def test_the_table_sets_published_values_beside_ours(everything: Any) -> None:
    table = (everything.folder / "table.md").read_text().splitlines()
    assert table[0] == "|  | published | reproduced | our best |"
    assert {line.count("|") for line in table} == {5}
    ratio = next(line for line in table if "eq. 7" in line)
    measured = everything.facts("error-ratio")["numbers"]["measured"]["ratios"]
    cells = [cell.strip() for cell in ratio.split("|")]
    assert cells[2:5] == ["2.75", f"{measured['paper']:.3g}", f"{measured['default']:.3g}"]
    assert any("0.053" in line for line in table)
    page = (everything.folder / "index.html").read_text()
    assert all(f"<td>{cell}</td>" in page for cell in cells[2:5])


def test_pipelines_run_once_for_all_studies(everything: Any) -> None:
    assert everything.err.count("running the pipeline default") == 1
    assert everything.err.count("running the pipeline paper") == 1


@pytest.mark.parametrize("name", ["step-size", "histograms"])
def test_a_second_run_gives_the_same_numbers(everything: Any, name: str, tmp_path: Path) -> None:
    study = STUDIES[name](**STUDIES[name].fast)
    again = study.run(given(everything.folder / "case.h5", tmp_path))
    facts = everything.facts(name)
    assert plain(again.table) == facts["table"]
    assert plain(again.numbers) == facts["numbers"]


@pytest.fixture(scope="module")
def unknown(everything: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan whose true angles nobody knows."""
    path = tmp_path_factory.mktemp("unknown") / "real.h5"
    shutil.copy(everything.folder / "case.h5", path)
    with h5py.File(path, "r+") as file:
        del file["simulation"]
    return path


def test_a_scan_without_truth_is_judged_by_its_recorded_steps_and_says_so(
    unknown: Path, tmp_path: Path
) -> None:
    case = given(unknown, tmp_path)
    assert "whose true angles nobody knows" in case.origin
    outcome = STUDIES["histograms"](step_deg=9.0).run(case)
    assert outcome.numbers["reference"] == "recorded"
    kinds = {row["values"] for row in outcome.table}
    assert kinds == {"measured", "measured - recorded"}
    assert "recorded steps" in outcome.conclusion or "too few to tell" in outcome.conclusion


def test_no_error_ratio_is_measured_without_truth(
    unknown: Path, tmp_path: Path, everything: Any
) -> None:
    study = STUDIES["error-ratio"](**STUDIES["error-ratio"].fast)
    outcome = study.run(given(unknown, tmp_path))
    assert outcome.numbers["measured"] is None
    assert "are not known" in outcome.conclusion
    assert outcome.claims[0].reproduced == outcome.claims[0].best == "-"
    # The Monte Carlo is that of the run on another scan, to the last digit.
    assert plain(outcome.table) == everything.facts("error-ratio")["table"]


def test_slices_of_a_scan_without_truth_have_no_psnr(everything: Any) -> None:
    from tomoslam_stage.studies.sd_card import claims, conclusion

    figures = {
        name: {"frc_resolution_px": 3.0, "edge_width_px": 2.0}
        for name in ("recorded", "paper", "default")
    }
    said = conclusion(figures, {})
    assert "nothing says which slices are right" in said
    assert claims(figures) == []
    assert "PSNR and SSIM against" in everything.facts("sd-card")["conclusion"]


def test_true_angles_beat_nothing_and_ratios_are_finite(everything: Any) -> None:
    ratios = everything.facts("error-ratio")["table"]
    walk = [row["ratio_of_means"] for row in ratios if row["reading"] == "walk"]
    assert np.isfinite(walk).all()
    assert min(walk) > 0.95


def refused(*words: object) -> tuple[int, str]:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(["study", *map(str, words)])
    return code, err.getvalue()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["step-sizes"], "'step-size'"),
        (["timing", "--set", "run=3"], "Did you mean 'runs'?"),
        (["timing", "--set", "runs=0"], "study.timing.runs"),
        (["all", "--set", "draws=3"], "error-ratio.draws=100"),
        (["timing", "--set", "case.rosw=3"], "Did you mean 'rows'?"),
        (["timing", "scan.h5", "--set", "case.rows=3"], "scan.h5 is a scan"),
        (["timing", "missing.h5"], "missing.h5"),
    ],
)
def test_what_does_not_fit_is_answered_with_what_would(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, err = refused(*words, "--output", tmp_path / "out")
    assert code in (2, 3)
    assert said in err
    assert "Traceback" not in err


def test_parameters_of_one_study_need_no_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(STUDIES["timing"], "run", recorded(seen))
    small = ("--set", "case.n_projections=5", "--set", "case.rows=8", "--set", "case.columns=32")
    code, err = refused(
        "timing", "--set", "runs=3", "--set", "timing.angles=[40]", *small, "--output", tmp_path
    )
    assert code == 1  # of the stand-in below
    assert [(study.runs, study.angles) for study in seen] == [(3, (40,))], err


def recorded(seen: list[Any]) -> Callable[..., Any]:
    def run(self: Any, case: Any) -> Any:  # noqa: ARG001
        seen.append(self)
        raise RuntimeError("stop here")

    return run
