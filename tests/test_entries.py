from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tomoslam_stage.entries import apply_settings, load_pipeline, pipeline_names
from tomoslam_stage.errors import PipelineError


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


def test_the_pipelines_of_the_package_load_by_name_in_the_order_that_writes_last() -> None:
    assert pipeline_names() == ["default", "fast", "paper", "sirt", "stripes"]
    for name in pipeline_names():
        written = load_pipeline(name)
        ours = [e.method for e in written if e.module_path == "tomoslam_stage.stages"]
        assert ours == ["load_scan", "refine_theta", "reconstruct", "compare", "write_theta"]


def test_an_unknown_pipeline_is_answered_with_the_nearest_name() -> None:
    assert refused(load_pipeline, "defualt") == (
        "defualt: no such pipeline; a name or a YAML file is needed. Did you mean 'default'?"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "mine.yaml:1: no list of entries; a pipeline needs one or more."),
        ("method: x", "mine.yaml:1: no list of entries; a pipeline needs one or more."),
        (
            "- load_scan",
            "mine.yaml:1: no entry; an entry is a mapping that has a 'method'.",
        ),
        (
            "- method: load_scan",
            "mine.yaml:1: the entry has no 'module_path'; a name is needed.",
        ),
        (
            entry("load_scan", more="  paramters: {}\n"),
            "mine.yaml:4: an entry has no key 'paramters'. Did you mean 'parameters'?",
        ),
        (
            entry("load_scan", "[1]"),
            "mine.yaml:3: parameters is [1]; a mapping is needed.",
        ),
        (
            entry("load_scan", more="  save_result: 1\n"),
            "mine.yaml:4: save_result is 1; true or false is needed.",
        ),
        (
            entry("load_scan", more="  side_outputs: {axis: [a]}\n"),
            "mine.yaml:4: the side output 'axis' is called ['a']; a word is needed.",
        ),
        (
            entry("load_scan", "{binning: 1,\n    binning: 2}"),
            "mine.yaml:4: the key 'binning' is given twice, first in line 3. "
            "Leave one of them out.",
        ),
        (
            entry("load_scan", more="  id: a b\n"),
            "mine.yaml:4: the id 'a b' is no word of letters, digits, '_' and '-'.",
        ),
        (
            entry("load_scan", more="  id: a\n") + entry("load_scan", more="  id: a\n"),
            "mine.yaml:8: the id 'a' is taken by the entry at mine.yaml:1. "
            "Ids are unique; choose another.",
        ),
        (
            entry("load_scan", "{binning: !!python/object/apply:os.getcwd []}"),
            "mine.yaml:3: the tag !!python/object/apply:os.getcwd is not taken; "
            "only plain values are.",
        ),
        (
            entry("load_scan", "{binning: !Sweep [1, 2]}"),
            "mine.yaml:3: !Sweep is not taken: one run refines a scan with one value of each "
            "parameter. Give one value, and run once for each of the others.",
        ),
        (entry("load_scan", "{1: 2}"), "mine.yaml:3: '1' is no key; a key is a word."),
        (entry("load_scan", "{a: !!int b}"), "mine.yaml:3: 'b' is no !!int."),
        (entry("load_scan", "{a: *b}"), "mine.yaml:3: found undefined alias 'b'."),
        ("- a: [1\n", "mine.yaml:2: expected ',' or ']', but got '<stream end>'."),
        ("- a\n---\n- b", "mine.yaml:2: but found another document."),
        (f"- {'[' * 30}{']' * 30}", "mine.yaml:1: nested more than 20 deep."),
        ("- " + "[" * 5000, "mine.yaml:1: nested more than 20 deep."),
        ("- &a [*a]", "mine.yaml:1: nested more than 20 deep."),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(pipeline: Any, text: str, message: str) -> None:
    assert refused(pipeline, text) == message


def test_an_alias_bomb_is_refused(pipeline: Any) -> None:
    lines = ["- a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"  a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    message = refused(pipeline, "\n".join(lines))
    assert re.fullmatch(
        r"mine.yaml:\d+: more than 10000 values once aliases are followed\.", message
    )


def test_a_bomb_of_merged_mappings_is_refused(pipeline: Any) -> None:
    lines = ["- a0: &a0 {x: 1}"]
    merged = [f"  a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 8)}]}}" for n in range(1, 9)]
    assert "more than 10000 values" in refused(pipeline, "\n".join(lines + merged))


def test_a_file_that_is_no_text_or_far_too_long_is_refused(pipeline: Any) -> None:  # noqa: ARG001
    Path("scan.h5").write_bytes(b"\x89HDF\xff\xfe")
    assert refused(load_pipeline, "scan.h5").startswith("scan.h5: not a text in UTF-8")
    Path("scan.h5").write_bytes(b"\0" * 100_001)
    found = "scan.h5: 100001 bytes; a pipeline has at most 100000."
    assert refused(load_pipeline, "scan.h5") == found


def test_values_are_read_as_scientists_write_them(pipeline: Any) -> None:
    text = "{a: 1e-3, b: 10:50:10, c: 2026-05-01, d: [1, .5], e: null, f: yes, g: '1'}"
    parameters = pipeline(entry("load_scan", text))[0].parameters
    assert parameters == {
        "a": 1e-3, "b": "10:50:10", "c": "2026-05-01",
        "d": [1, 0.5], "e": None, "f": True, "g": "1",
    }  # fmt: skip


def test_merged_keys_give_way_to_own_ones(pipeline: Any) -> None:
    first = entry("load_scan", "&common {binning: 2, fails: true}")
    second = entry("load_scan", "{<<: *common, binning: 3}")
    assert pipeline(first + second)[1].parameters == {"binning": 3, "fails": True}


@pytest.mark.parametrize(
    ("setting", "parameters"),
    [
        ("refine_theta.steps_deg=[4,10]", {"steps_deg": [4, 10]}),
        ("refine_theta.detector.keypoints=500", {"detector": {"keypoints": 500}}),
        ("refine_theta.axis=", {"axis": None}),
        ("refine_theta.axis=1e2", {"axis": 100.0}),
        ("finer.axis=3", {"axis": 3}),
        ("refine_theta.note=a=b", {"note": "a=b"}),
    ],
)
def test_a_setting_is_a_path_and_a_yaml_value(
    pipeline: Any, setting: str, parameters: dict[str, Any]
) -> None:
    entries = pipeline(entry("load_scan") + entry("refine_theta", more="  id: finer\n"))
    changed = apply_settings(entries, [setting])
    assert changed[1].parameters == parameters
    assert entries[1].parameters == {}


def test_a_setting_reaches_into_a_method_given_by_its_name(pipeline: Any) -> None:
    entries = pipeline(entry("refine_theta", "{detector: sift}"))
    changed = apply_settings(entries, ["refine_theta.detector.keypoints=5"])
    assert changed[0].parameters == {"detector": {"method": "sift", "keypoints": 5}}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            "refin_theta.axis=3",
            "the pipeline has no entry 'refin_theta'. Did you mean 'refine_theta'?",
        ),
        (
            "refine_theta=3",
            "no parameter of refine_theta; ENTRY.PARAMETER=VALUE is needed, "
            "as in refine_theta.steps_deg=[4,10].",
        ),
        ("refine_theta.axis", "no setting; KEY=VALUE is needed."),
        ("refine_theta..axis=1", "no setting; KEY=VALUE is needed."),
        ("refine_theta.axis.x=1", "axis is 3, which has no 'x'."),
        ("refine_theta.axis=[1", "expected ',' or ']', but got '<stream end>'."),
        (
            "load_scan.binning=2",
            "'load_scan' may be mine.yaml:1 and mine.yaml:4. Give them ids and use those.",
        ),
        (
            "refine_theta.axis=!!python/name:os.system",
            "the tag !!python/name:os.system is not taken; only plain values are.",
        ),
    ],
)
def test_a_wrong_setting_is_refused(pipeline: Any, setting: str, message: str) -> None:
    text = entry("load_scan") * 2 + entry("refine_theta", "{axis: 3}")
    found = refused(apply_settings, pipeline(text), [setting])
    assert found == f"--set {setting}: {message}"
