"""What shells complete, and that every command shows an example."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tomoslam_stage.cli import COMMANDS, completing, main, parsers
from tomoslam_stage.exports import FORMATS
from tomoslam_stage.pipeline import pipeline_names
from tomoslam_stage.stages import STAGES
from tomoslam_stage.studies import STUDIES


@pytest.mark.parametrize("name", [*COMMANDS, ""])
def test_the_help_of_every_command_has_an_example(name: str) -> None:
    said = parsers()[name].format_help()
    assert f"python -m tomoslam_stage {name}".strip() in said.partition("example")[2]


def test_the_words_that_are_completed_are_those_there_are() -> None:
    assert sorted(completing.VALUES["--pipeline"]) == pipeline_names()
    assert set(completing.VALUES["--format"]) == set(FORMATS)
    assert set(completing.WORDS["describe"]) == set(STAGES)
    assert set(completing.WORDS["study"]) == {*STUDIES, "all"}
    assert set(completing.WORDS["completion"]) == set(completing.SHELLS)


@pytest.mark.parametrize("shell", completing.SHELLS)
def test_what_is_printed_is_in_the_language_of_the_shell(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", shell]) == 0
    written = tmp_path / "completion"
    written.write_text(capsys.readouterr().out)
    assert "drop-frames" in written.read_text()
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    subprocess.run([program, "-n", str(written)], check=True)


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (("de",), "describe"),
        (("scan.h5", "--save"), "--save-slices"),
        (("scan.h5", "--pipeline", "fa"), "fast"),
        (("study", "err"), "error-ratio"),
        (("export", "scan.h5", "--format", "na"), "nabu"),
        (("scan.h5", "sc"), "scan.h5"),
    ],
)
def test_bash_completes(words: tuple[str, ...], completed: str, tmp_path: Path) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    (tmp_path / "scan.h5").touch()
    call = " ".join(words)
    script = f"""{completing.bash(parsers())}
COMP_WORDS=({completing.SCRIPT} {call}); COMP_CWORD={len(words)}; _tomoslam_stage
echo "${{COMPREPLY[@]}}\""""
    done = subprocess.run(
        [bash, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [completed]


def test_an_unknown_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bahs"]) == 2
    assert "Did you mean 'bash'?" in capsys.readouterr().err
