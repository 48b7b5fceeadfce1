"""Pipelines that want too much, or nothing that can be: one line each, and nothing is done."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from tomoslam_stage.cli import main
from tomoslam_stage.stages import MODULES

LOAD = "- method: load_scan\n  module_path: tomoslam_stage.stages\n"
KNOWN = f"Known: {', '.join(sorted(MODULES))}."
STAGES = "Known: compare, load_scan, reconstruct, refine_theta, write_theta."
PLAIN = "is not taken; only plain values are."
BOMB = "- a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"  a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 10)
)


def entry(method: str, parameters: str = "{}", module: str = "tomoslam_stage.stages") -> str:
    return f"- method: {method}\n  module_path: {module}\n  parameters: {parameters}\n"


def refine(parameters: str) -> str:
    return LOAD + entry("refine_theta", parameters)


CASES: dict[str, tuple[str, str]] = {
    "a module of Python": (
        entry("system", module="os"),
        f"2: the module_path 'os' is not taken. {KNOWN}",
    ),
    "what is built in": (
        entry("eval", module="builtins"),
        f"2: the module_path 'builtins' is not taken. {KNOWN}",
    ),
    "our own inside": (
        entry("edit", module="tomoslam_stage.scans.transaction"),
        "2: the module_path 'tomoslam_stage.scans.transaction' is not taken. "
        "Did you mean 'tomoslam_stage.stages'?",
    ),
    "a module of tomopy that is not on the list": (
        entry("c_shared_lib", module="tomopy.util.extern"),
        "2: the module_path 'tomopy.util.extern' is not taken. Did you mean 'tomopy.misc.corr'?",
    ),
    "a class that is no stage": (
        entry("Work"),
        f"1: tomoslam_stage.stages has no method 'Work'. {STAGES}",
    ),
    "a name Python made": (
        entry("__import__"),
        f"1: tomoslam_stage.stages has no method '__import__'. {STAGES}",
    ),
    "a module that is a list": (
        entry("x", module="[os]"),
        "2: module_path is ['os']; a name is needed.",
    ),
    "a call": (
        entry("load_scan", "!!python/object/apply:os.system ['touch pwned']"),
        f"3: the tag !!python/object/apply:os.system {PLAIN}",
    ),
    "a name": (
        entry("load_scan", "{kind: !!python/name:os.system }"),
        f"3: the tag !!python/name:os.system {PLAIN}",
    ),
    "bytes": (entry("load_scan", "{kind: !!binary aGk=}"), f"3: the tag !!binary {PLAIN}"),
    "a tag of one's own": (entry("load_scan", "!x {}"), f"3: the tag !x {PLAIN}"),
    "a bomb of aliases": (BOMB, "1: more than 10000 values once aliases are followed."),
    "an alias of itself": ("- &a\n  method: *a\n", "1: nested more than 20 deep."),
    "a merge of itself": ("- &a\n  <<: *a\n", "1: nested more than 20 deep."),
    "deep brackets": ("- " + "[" * 5000, "1: nested more than 20 deep."),
    "deep mappings": ("- " + "{a: " * 3000, "1: nested more than 20 deep."),
    "a number without end": (
        entry("load_scan", "{binning: " + "9" * 5000 + "}"),
        f"3: '{'9' * 40}' is no !!int.",
    ),
    "a control character": (
        "- method: a\0b\n",
        "1: no YAML text: unacceptable character #x0000: special characters are not allowed in "
        '"<unicode string>", position 11.',
    ),
    "an unknown key": (
        LOAD + "  command: rm\n",
        "3: an entry has no key 'command'. Known: id, method, module_path, parameters, "
        "save_result, side_outputs.",
    ),
    "an unknown key of a method in a method": (
        refine("{tracks: {detector: {method: sift, keypoint: 3}}}"),
        "5: tracks.detector.sift: no parameter 'keypoint'. Did you mean 'keypoints'?",
    ),
    "a word for a number": (
        entry("load_scan", "{binning: two}"),
        "3: load_scan.binning: 'two' does not fit: Input should be a valid integer, unable to "
        "parse string as an integer.",
    ),
    "a switch for a number": (
        refine("{mapping: {strengths: [0.0, yes]}}"),
        "5: refine_theta.mapping.strengths.1: a switch (true, false, yes, no, on, off) does not "
        "fit; a number is needed.",
    ),
    "nothing to choose from": (
        refine("{closer: {faintest: []}}"),
        "5: refine_theta.closer.faintest: [] does not fit: Tuple should have at least 1 item after "
        "validation, not 0.",
    ),
    "a list for a number": (
        entry("load_scan", "{binning: [1]}"),
        "3: load_scan.binning: [1] does not fit: Input should be a valid integer.",
    ),
    "no number": (
        refine("{axis: .nan}"),
        "5: refine_theta.axis: nan does not fit: Input should be a finite number.",
    ),
    "a number for a method": (
        refine("{tracks: 3}"),
        "5: refine_theta.tracks: 3 does not fit: Input should be a dictionary or an instance of "
        "Tracking.",
    ),
    "a path where a switch is": (
        LOAD + "  save_result: /etc/passwd\n",
        "3: save_result is '/etc/passwd'; true or false is needed.",
    ),
    "a path for an id": (
        LOAD + "  id: ../x\n",
        "3: the id '../x' is no word of letters, digits, '_' and '-'.",
    ),
    "a reference to nothing": (
        refine("{axis: '${{a.side_outputs.b}}'}"),
        "5: no earlier entry has the id 'a'. None of them has an id.",
    ),
    "a reference within a text": (
        refine("{axis: 'x${{a.side_outputs.b}}'}"),
        "5: the reference 'x${{a.side_outputs.b}}' cannot be read; ${{id.side_outputs.name}} as "
        "the whole value of a parameter is needed.",
    ),
}


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("case", CASES)
def test_a_hostile_pipeline_is_answered_with_one_line(
    capsys: pytest.CaptureFixture[str], case: str
) -> None:
    text, found = CASES[case]
    Path("mine.yaml").write_text(text)
    assert main(["check", "mine.yaml"]) == 2
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", f"error: mine.yaml:{found}\n")
    assert list(Path().iterdir()) == [Path("mine.yaml")]


def test_what_a_file_says_does_not_command_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.yaml").write_text('- method: "a\\e[31m\\nb"\n  module_path: tomoslam_stage.stages\n')
    assert main(["check", "mine.yaml"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told[:-1].isprintable()


PIECES = [
    *"{}[]:-&*!%@`'\"#|>?,\n \t\\",
    "<<: *a",
    "&a ",
    "!!int ",
    "null",
    ".inf",
    "-1",
    "1e999",
    "${{refine.side_outputs.axis}}",
    "0x",
    "ü",
    "\x85",
    "- ",
]


def spoiled(text: str, random: Random) -> str:
    """Cut something out, double something, or put something in, a few times."""
    for _ in range(random.randint(1, 4)):
        at = random.randrange(len(text))
        end = min(len(text), at + random.choice([1, 5, 40, 400]))
        middle = random.choice(["", 2 * text[at:end], random.choice(PIECES) + text[at:end]])
        text = text[:at] + middle + text[end:]
    return text


def test_a_spoiled_pipeline_runs_or_is_answered_with_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sound = (Path(__file__).parents[1] / "pipelines" / "default.yaml").read_text()
    random, codes = Random(4), set()
    for _ in range(80):
        text = spoiled(sound, random)
        Path("mine.yaml").write_text(text)
        code = main(["check", "mine.yaml"])
        told = capsys.readouterr().err
        assert code in (0, 2), f"{told}\n{text}"
        assert [line.startswith("error: ") for line in told.splitlines()].count(True) == code / 2
        codes.add(code)
    assert codes == {0, 2}
