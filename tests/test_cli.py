from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
from argparse import ArgumentTypeError
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import pytest

from tomoslam_stage import cli, console
from tomoslam_stage.cli.arguments import row_list
from tomoslam_stage.errors import BackendMissingError, PipelineError, ScanError
from tomoslam_stage.methods import method
from tomoslam_stage.progress import progress
from tomoslam_stage.stages.modules import Module
from tomoslam_stage.stages.work import Writer
from tomoslam_stage.stopping import Stopped

SHOWN = "what the report says"


@dataclass
class StandInWork:
    """Stands in for Work."""

    path: Path
    folder: Path
    output: Path | None = None
    dry_run: bool = False
    started: str = "2026-05-01T12:00:00+00:00"
    seconds: dict[str, float] = field(default_factory=dict)
    pipeline: list[dict[str, Any]] = field(default_factory=list)
    refinement: Any = None
    report: dict[str, Any] | None = None


@method
class StandInLoad:
    """Stands in for load_scan."""

    makes: ClassVar = ("scan",)
    works: ClassVar[list[StandInWork]] = []

    binning: int = 1
    parallel: bool = False
    drop_frames: str = ""
    keep_frames: str = ""
    drop_angles: str = ""

    def run(self, work: StandInWork) -> dict[str, Any]:
        self.works.append(work)
        return {}


@method
class StandInRefine:
    """Stands in for refine_theta."""

    needs: ClassVar = ("scan",)
    makes: ClassVar = ("refinement",)
    result: ClassVar[Any] = None

    axis: float | None = None
    tracks: Any = None

    def run(self, work: StandInWork) -> dict[str, Any]:
        if isinstance(self.result, BaseException):
            raise self.result
        work.refinement = SimpleNamespace(status=self.result)
        return {}


@method
class StandInReconstruct:
    """Stands in for reconstruct."""

    needs: ClassVar = ("refinement",)
    makes: ClassVar = ("reconstructions",)

    rows: list[int] | None = None

    def run(self, work: StandInWork) -> dict[str, Any]:  # noqa: ARG002
        return {}


@method
class StandInCompare:
    """Stands in for compare."""

    needs: ClassVar = ("reconstructions",)

    save_tiff: bool = False

    def run(self, work: StandInWork) -> dict[str, Any]:
        work.report = {"said": SHOWN}
        return {}


@method
class StandInWrite:
    """Stands in for write_theta."""

    needs: ClassVar = ("refinement",)
    trouble: ClassVar[Exception | None] = None

    def run(self, work: StandInWork) -> dict[str, Any]:  # noqa: ARG002
        if self.trouble is not None:
            raise self.trouble
        return {}


PIPELINE = "".join(
    f"- method: {name}\n  module_path: tomoslam_stage.stages\n"
    for name in ("load_scan", "refine_theta", "reconstruct", "compare", "write_theta")
)


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[StandInRefine]:
    """Stand-ins for the stages and the summary, and a pipeline.yaml of them."""
    stand_in: Any = ModuleType("tomoslam_stage.stages")
    stand_in.Work, stand_in.Writer = StandInWork, Writer
    ours = {
        "load_scan": StandInLoad,
        "refine_theta": StandInRefine,
        "reconstruct": StandInReconstruct,
        "compare": StandInCompare,
        "write_theta": StandInWrite,
    }
    stand_in.MODULES = {"tomoslam_stage.stages": Module(ours)}
    comparison: Any = ModuleType("tomoslam_stage.comparison")
    comparison.summary = lambda report, folder, unicode: f"{report['said']} in {folder.name}"  # noqa: ARG005
    monkeypatch.setitem(sys.modules, "tomoslam_stage.stages", stand_in)
    monkeypatch.setitem(sys.modules, "tomoslam_stage.comparison", comparison)
    monkeypatch.setattr(StandInLoad, "works", [])
    monkeypatch.setattr(StandInRefine, "result", "accepted")
    monkeypatch.chdir(tmp_path)
    Path("pipeline.yaml").write_text(PIPELINE)
    return StandInRefine


def called(*words: str) -> int:
    return cli.main(["scan.h5", "--pipeline", "pipeline.yaml", *words])


def error_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("error: ")]


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from tomoslam_stage.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit as end: assert end.code == 0\n"
        "heavy = {'numpy', 'h5py', 'scipy', 'pydantic', 'rich', 'yaml'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "inspect SCAN" in done.stdout


def test_the_module_ends_with_the_exit_code() -> None:
    words = [sys.executable, "-m", "tomoslam_stage", "scan.h5", "--pipeline", "defualt"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        "error: defualt: no such pipeline; a name or a YAML file is needed. "
        "Did you mean 'default'?\n"
    )


@pytest.mark.parametrize(("status", "code"), [("accepted", 0), ("kept", 4)])
def test_kept_angles_end_with_4_after_the_report(
    stages: type[StandInRefine], capsys: pytest.CaptureFixture[str], status: str, code: int
) -> None:
    stages.result = status
    assert called() == code
    assert capsys.readouterr().out == f"{SHOWN} in scan_tomoslam\n"


@pytest.mark.parametrize(
    ("trouble", "code", "line"),
    [
        (PipelineError("x", "wrong."), 2, "x: wrong."),
        (ScanError("scan.h5", "no\ndata.", "Look."), 3, "scan.h5: no data. Look."),
        (BackendMissingError("tomopy", "not installed."), 5, "tomopy: not installed."),
        (PermissionError(13, "Permission denied", "/r/o"), 2, "/r/o: Permission denied"),
        (
            Stopped(signal.SIGINT),
            130,
            "interrupted; no angles were written, the report is incomplete",
        ),
        (
            Stopped(signal.SIGTERM),
            143,
            "terminated; no angles were written, the report is incomplete",
        ),
        (MemoryError("5 TiB"), 1, "this machine has too little memory: 5 TiB"),
        (KeyError("x"), 1, "this is a bug: KeyError: 'x' (-v or --log FILE shows where)"),
    ],
)
def test_trouble_becomes_one_line_and_an_exit_code(
    stages: type[StandInRefine],
    capsys: pytest.CaptureFixture[str],
    trouble: BaseException,
    code: int,
    line: str,
) -> None:
    stages.result = trouble
    assert called() == code
    told = capsys.readouterr()
    assert error_lines(told.err) == [f"error: {line}"]
    assert "Traceback" not in told.err
    assert told.out == ""


def test_the_traceback_of_a_bug_goes_to_the_log_file_or_with_v_to_stderr(
    stages: type[StandInRefine], capsys: pytest.CaptureFixture[str]
) -> None:
    stages.result = KeyError("x")
    called("--log", "run.log")
    assert "Traceback" not in capsys.readouterr().err
    assert "Traceback" in Path("run.log").read_text()
    called("-v")
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.usefixtures("stages")
def test_the_summary_is_printed_even_if_writing_fails(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StandInWrite, "trouble", ScanError("scan.h5", "locked."))
    assert called() == 3
    assert capsys.readouterr().out == f"{SHOWN} in scan_tomoslam\n"


@pytest.mark.usefixtures("stages")
def test_short_options_set_parameters_and_set_has_the_last_word() -> None:
    words = "--bin 2 --parallel --axis 31.5 --rows 1:6:2 --save-slices --set load_scan.binning=4 "
    words += "--drop-frames 12,40:43 --drop-angles 7 --keep-frames : --cache kept"
    assert called(*words.split()) == 0
    parameters = [e["parameters"] for e in StandInLoad.works[0].pipeline]
    named = {"drop_frames": "12,40:43", "drop_angles": "7", "keep_frames": ":"}
    assert parameters[0] == {"binning": 4, "parallel": True, **named}
    assert parameters[1] == {"axis": 31.5, "tracks": {"cache": "kept"}}
    assert parameters[2] == {"rows": [1, 3, 5]}
    assert parameters[3] == {"save_tiff": True}


@pytest.mark.usefixtures("stages")
def test_nothing_runs_when_a_setting_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert called("--set", "write_theta.speed=3") == 2
    assert StandInLoad.works == []
    assert capsys.readouterr().err.startswith("error: --set write_theta.speed=3: write_theta: no")


@pytest.mark.usefixtures("stages")
def test_folder_output_and_dry_run_reach_the_work() -> None:
    called("--output", "small.h5", "--report", "there")
    called("--dry-run")
    first, second = StandInLoad.works
    assert (first.folder, first.output, first.dry_run) == (Path("there"), Path("small.h5"), False)
    assert (second.folder, second.output) == (Path("scan_tomoslam"), None)
    assert second.dry_run


@pytest.mark.usefixtures("stages")
def test_output_onto_the_scan_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert called("--output", "./scan.h5") == 2
    line = "error: --output: scan.h5 is the scan itself. Choose another file.\n"
    assert capsys.readouterr().err == line
    assert StandInLoad.works == []


@pytest.mark.usefixtures("stages")
def test_a_log_file_that_cannot_be_opened_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert called("--log", "no/where/run.log") == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert told.endswith("no/where/run.log: No such file or directory\n")
    assert StandInLoad.works == []


@pytest.mark.parametrize("words", [[], ["scan.h5", "--bin"], ["scan.h5", "--no-such"]])
def test_wrong_words_end_with_2(words: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    assert end.value.code == 2


def test_a_scan_called_like_a_command_is_reached_by_its_path(stages: object) -> None:  # noqa: ARG001
    assert cli.main(["./inspect", "--pipeline", "pipeline.yaml"]) == 0
    assert StandInLoad.works[0].path == Path("inspect")


@pytest.mark.parametrize(
    ("text", "rows"),
    [("10", [10]), ("10,50,100", [10, 50, 100]), ("10:40:10", [10, 20, 30]), ("3:5", [3, 4])],
)
def test_rows_are_a_list_or_a_range(text: str, rows: list[int]) -> None:
    assert row_list(text) == rows


@pytest.mark.parametrize("text", ["", "a", "1,,2", "5:5", "1:9:0", "1:2:3:4", "-1", ":"])
def test_rows_that_name_none_are_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="names no rows"):
        row_list(text)


def test_a_simulated_scan_can_be_inspected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "made.h5")
    size = "--phantom smooth --projections 12 --rows 4 --columns 32 --span 180 --seed 7"
    assert cli.main(["simulate", out, *size.split(), "--error", "none"]) == 0
    assert capsys.readouterr().out == f"{out}: 12 x 4 x 32 (projections, rows, columns)\n"
    assert cli.main(["inspect", out]) == 0
    said = capsys.readouterr().out.splitlines()
    lines = {line[:14].strip(): line[14:] for line in said}
    assert lines["file"] == "made.h5 (DXchange)"
    assert lines["projections"] == "12 of 4 rows x 32 columns, uint16"
    assert lines["angles"] == "0 to 165 degrees; steps of 15"
    assert lines["problems"] == "none"
    assert lines["simulated"] == "yes, with the true angles"
    assert cli.main(["inspect", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["shape"] == [12, 4, 32]


def test_the_errors_of_a_simulated_scan_add_up_and_its_file_says_so(tmp_path: Path) -> None:
    import h5py

    out = tmp_path / "made.h5"
    words = "--phantom smooth --projections 12 --rows 4 --columns 32 --error walk:0.2"
    words += " --error lost_step:1 --set detector.dust=3 --set roll_deg=0.5"
    assert cli.main(["simulate", str(out), *words.split()]) == 0
    with h5py.File(out) as file:
        recipe = json.loads(file["/simulation/parameters"][()])
    errors = [(e["method"], e.get("sigma_deg", e.get("size_deg"))) for e in recipe["angle_errors"]]
    assert errors == [("walk", 0.2), ("lost_step", 1.0)]
    assert (recipe["detector"]["dust"], recipe["roll_deg"]) == (3, 0.5)


def test_simulate_never_replaces_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "precious.h5"
    out.write_bytes(b"years of work")
    assert cli.main(["simulate", str(out)]) == 2
    found = f"error: {out}: exists already. Choose another name or remove it.\n"
    assert capsys.readouterr().err == found
    assert out.read_bytes() == b"years of work"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--phantom", "crad"], "simulate.phantom: no method 'crad'. Did you mean 'card'?"),
        (["--error", "wlak:1"], "simulate.angle_errors: no method 'wlak'. Did you mean 'walk'?"),
        (["--set", "spam_deg=1"], "simulate: no parameter 'spam_deg'. Did you mean 'span_deg'?"),
    ],
)
def test_a_wrong_recipe_is_answered_with_the_nearest_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], line: str
) -> None:
    out = tmp_path / "made.h5"
    assert cli.main(["simulate", str(out), *words]) == 2
    assert capsys.readouterr().err == f"error: {line}\n"
    assert not out.exists()


def test_inspect_and_revert_of_no_scan_end_with_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = str(tmp_path / "missing.h5")
    assert cli.main(["inspect", missing]) == 3
    assert cli.main(["revert", missing]) == 3
    assert len(error_lines(capsys.readouterr().err)) == 2


def test_inspect_says_what_is_wrong_and_ends_with_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import h5py

    empty = tmp_path / "empty.h5"
    h5py.File(empty, "w").close()
    assert cli.main(["inspect", str(empty)]) == 3
    assert "/exchange/data" in capsys.readouterr().out


def test_long_work_logs_a_line_after_ten_seconds_and_ten_percent(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    clock = iter(range(0, 1000, 2))
    monkeypatch.setattr(console, "monotonic", lambda: next(clock))
    lines = console.ProgressLines()
    for done in range(1, 101):
        lines("matching", done, 100)
    assert len(caplog.messages) == 9
    assert caplog.messages[0] == "matching: 11 of 100, about 178 s left"


def test_work_that_starts_again_is_timed_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    times = iter([0, 5, 100, 105, 111])
    monkeypatch.setattr(console, "monotonic", lambda: next(times))
    lines = console.ProgressLines()
    for done in (1, 2, 1, 2, 3):
        lines("matching", done, 4)
    assert caplog.messages == ["matching: 3 of 4, about 6 s left"]


def test_a_terminal_gets_bars_and_the_log_file_gets_the_lines(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 30))
    monkeypatch.setattr(console, "monotonic", lambda: next(clock))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    path = tmp_path / "run.log"
    with console.logging_to(path, verbose=False), console.progress_shown():
        for _ in progress(range(3), "matching", 3):
            pass
    assert "matching: 2 of 3, about 30 s left" in path.read_text()
    assert "about" not in capsys.readouterr().err


def test_logging_leaves_the_logger_as_it_was(tmp_path: Path) -> None:
    logger = logging.getLogger("tomoslam_stage")
    before = logger.level, list(logger.handlers)
    with console.logging_to(tmp_path / "run.log", verbose=True):
        assert (logger.level, logger.handlers) != before
    assert (logger.level, logger.handlers) == before
