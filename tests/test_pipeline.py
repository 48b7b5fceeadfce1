from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar

import pytest
import yaml
from pydantic import Field

from tomoslam_stage.errors import PipelineError, ScanError
from tomoslam_stage.methods import method
from tomoslam_stage.pipeline import apply_settings, check, load_pipeline, run
from tomoslam_stage.stages.modules import Module

RAN: list[Any] = []


@method
class StandInDetector:
    """Stands in for a method inside a method."""

    keypoints: int = 300


@method
class StandInLoad:
    """Stands in for load_scan."""

    makes: ClassVar = ("scan",)
    gives: ClassVar = ("axis", "n_rows")

    binning: Annotated[int, Field(ge=1)] = 1
    fails: bool = False

    def run(self, work: Any) -> dict[str, Any]:  # noqa: ARG002
        RAN.append(("load_scan", self.binning))
        if self.fails:
            raise ScanError("scan.h5", "unreadable.")
        return {"axis": 31.5, "n_rows": 8}


@method
class StandInRefine:
    """Stands in for refine_theta."""

    needs: ClassVar = ("scan",)
    makes: ClassVar = ("refinement",)

    axis: float | None = None
    steps_deg: tuple[float, ...] = (4.0, 5.0)
    detector: StandInDetector = field(default_factory=StandInDetector)

    def run(self, work: Any) -> dict[str, Any]:  # noqa: ARG002
        RAN.append(("refine_theta", self.axis, self.detector.keypoints))
        return {}


@method
class StandInCompare:
    """Stands in for compare."""

    needs: ClassVar = ("refinement",)
    makes: ClassVar = ("comparison",)

    def run(self, work: Any) -> dict[str, Any]:
        raise work.trouble or RuntimeError("no trouble was set")


@method
class StandInWrite:
    """Stands in for write_theta."""

    needs: ClassVar = ("refinement",)

    def run(self, work: Any) -> dict[str, Any]:  # noqa: ARG002
        RAN.append(("write_theta",))
        return {}


STAND_INS: dict[str, Any] = {
    "load_scan": StandInLoad,
    "refine_theta": StandInRefine,
    "compare": StandInCompare,
    "write_theta": StandInWrite,
}
MODULES = {"tomoslam_stage.stages": Module(STAND_INS)}


@dataclass
class StandInWork:
    """Stands in for Work."""

    trouble: Exception | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    pipeline: list[dict[str, Any]] = field(default_factory=list)


@pytest.fixture(autouse=True)
def _nothing_has_run() -> None:
    RAN.clear()


@pytest.fixture
def pipeline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)

    def load(text: str) -> Any:
        Path("mine.yaml").write_text(text)
        return load_pipeline("mine.yaml")

    return load


def entry(name: str, parameters: str = "{}", more: str = "") -> str:
    lines = f"- method: {name}\n  module_path: tomoslam_stage.stages\n  parameters: {parameters}\n"
    return lines + more


def refused(action: Any, *args: Any) -> str:
    with pytest.raises(PipelineError) as caught:
        action(*args)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            entry("lod_scan"),
            "mine.yaml:1: tomoslam_stage.stages has no method 'lod_scan'. "
            "Did you mean 'load_scan'?",
        ),
        (
            entry("load_scan").replace("tomoslam_stage.stages", "os"),
            "mine.yaml:2: the module_path 'os' is not taken. Known: tomoslam_stage.stages.",
        ),
        (
            entry("load_scan", "{fails: false,\n    binnig: 2}"),
            "mine.yaml:4: load_scan: no parameter 'binnig'. Did you mean 'binning'?",
        ),
        (
            entry("load_scan", "{fails: false,\n    binning: 0}"),
            "mine.yaml:4: load_scan.binning: 0 does not fit: "
            "Input should be greater than or equal to 1.",
        ),
        (
            entry("refine_theta") + entry("load_scan"),
            "mine.yaml:1: refine_theta needs the scan, which no earlier entry makes. "
            "Put load_scan before it.",
        ),
        (
            entry("load_scan", more="  id: a\n  side_outputs: {axsi: axis}\n"),
            "mine.yaml:5: load_scan has no side output 'axsi'. Did you mean 'axis'?",
        ),
        (
            entry("load_scan") + entry("refine_theta", more="  side_outputs: {a: b}\n"),
            "mine.yaml:7: refine_theta has no side output 'a'. It has none at all.",
        ),
    ],
)
def test_a_pipeline_is_refused_before_anything_runs(pipeline: Any, text: str, message: str) -> None:
    assert refused(check, pipeline(text), MODULES) == message


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        (
            "${{lod.side_outputs.column}}",
            "no earlier entry has the id 'lod'. Did you mean 'load'?",
        ),
        (
            "${{load.side_outputs.colum}}",
            "load has no side output 'colum'. Did you mean 'column'?",
        ),
        (
            "${{load.column}}",
            "the reference '${{load.column}}' cannot be read; "
            "${{id.side_outputs.name}} as the whole value of a parameter is needed.",
        ),
        (
            "[1, '${{load.side_outputs.column}}']",
            "the reference '${{load.side_outputs.column}}' cannot be read; "
            "${{id.side_outputs.name}} as the whole value of a parameter is needed.",
        ),
    ],
)
def test_a_wrong_reference_is_refused_with_its_line(
    pipeline: Any, reference: str, message: str
) -> None:
    load = entry("load_scan", more="  id: load\n  side_outputs: {axis: column}\n")
    refine = entry("refine_theta", f"\n    axis: {reference}")
    assert refused(check, pipeline(load + refine), MODULES) == f"mine.yaml:9: {message}"


def test_a_reference_gives_the_side_output_of_the_earlier_entry(pipeline: Any) -> None:
    load = entry("load_scan", more="  id: load\n  side_outputs: {axis: column}\n")
    refine = entry("refine_theta", "\n    axis: ${{ load.side_outputs.column }}")
    work = StandInWork()
    run(pipeline(load + refine), work, MODULES)
    assert RAN == [("load_scan", 1), ("refine_theta", 31.5, 300)]
    assert work.pipeline[1]["parameters"]["axis"] == "${{ load.side_outputs.column }}"


def test_a_side_output_that_does_not_fit_is_refused_with_its_line(pipeline: Any) -> None:
    class Wordy(StandInLoad):
        def run(self, work: Any) -> dict[str, Any]:  # noqa: ARG002
            return {"axis": "left"}

    load = entry("load_scan", more="  id: load\n  side_outputs: {axis: column}\n")
    refine = entry("refine_theta", "\n    axis: ${{load.side_outputs.column}}")
    entries = pipeline(load + refine)
    message = refused(
        run,
        entries,
        StandInWork(),
        {"tomoslam_stage.stages": Module({**STAND_INS, "load_scan": Wordy})},
    )
    assert message.startswith("mine.yaml:9: refine_theta.axis: 'left' does not fit: ")


def test_nothing_runs_when_the_last_entry_is_wrong(pipeline: Any) -> None:
    text = entry("load_scan") + entry("refine_theta", "{stepz: 1}")
    refused(run, pipeline(text), StandInWork(), MODULES)
    assert RAN == []


def test_the_pipeline_as_run_has_every_default_and_loads_again(pipeline: Any) -> None:
    work = StandInWork()
    run(pipeline(entry("load_scan", more="  id: load\n") + entry("refine_theta")), work, MODULES)
    assert work.pipeline == [
        {
            "method": "load_scan",
            "module_path": "tomoslam_stage.stages",
            "parameters": {"binning": 1, "fails": False},
            "id": "load",
        },
        {
            "method": "refine_theta",
            "module_path": "tomoslam_stage.stages",
            "parameters": {
                "axis": None,
                "steps_deg": [4.0, 5.0],
                "detector": {"keypoints": 300},
            },
        },
    ]
    again = StandInWork()
    run(pipeline(yaml.safe_dump(work.pipeline)), again, MODULES)
    assert again.pipeline == work.pipeline
    assert list(work.seconds) == ["load", "refine_theta"]
    assert all(seconds >= 0 for seconds in work.seconds.values())


def test_angles_are_written_even_if_the_report_fails_and_the_failure_is_told(
    pipeline: Any, caplog: pytest.LogCaptureFixture
) -> None:
    names = ("load_scan", "refine_theta", "compare", "write_theta")
    trouble = OSError(28, "No space left on device")
    with pytest.raises(OSError, match="No space left") as caught:
        run(pipeline("".join(map(entry, names))), StandInWork(trouble), MODULES)
    assert caught.value is trouble
    assert RAN[-1] == ("write_theta",)
    assert "compare failed; write_theta does without it" in caplog.messages


def test_a_failure_stops_all_that_need_its_product_and_says_no_more_than_that(
    pipeline: Any, caplog: pytest.LogCaptureFixture
) -> None:
    text = entry("load_scan", "{fails: true}") + entry("refine_theta") + entry("write_theta")
    with pytest.raises(ScanError):
        run(pipeline(text), StandInWork(), MODULES)
    assert RAN == [("load_scan", 1)]
    assert [r for r in caplog.records if r.levelname == "WARNING"] == []


def test_an_interrupt_stops_at_once(pipeline: Any) -> None:
    names = ("load_scan", "refine_theta", "compare", "write_theta")
    work: Any = SimpleNamespace(trouble=KeyboardInterrupt(), seconds={}, pipeline=[])
    with pytest.raises(KeyboardInterrupt):
        run(pipeline("".join(map(entry, names))), work, MODULES)
    assert RAN[-1][0] == "refine_theta"


def test_save_result_is_said_to_change_nothing(
    pipeline: Any, caplog: pytest.LogCaptureFixture
) -> None:
    check(pipeline(entry("load_scan", more="  save_result: true\n")), MODULES)
    assert caplog.messages == [
        "mine.yaml:4: save_result changes nothing here; "
        "the parameters of load_scan say what is kept"
    ]


def test_an_unknown_parameter_of_a_setting_is_answered_with_the_nearest(pipeline: Any) -> None:
    entries = apply_settings(pipeline(entry("load_scan")), ["load_scan.bining=2"])
    assert refused(check, entries, MODULES) == (
        "--set load_scan.bining=2: load_scan: no parameter 'bining'. Did you mean 'binning'?"
    )
