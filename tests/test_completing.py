"""What shells complete, and that every command shows an example."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tomoslam_stage.cli import COMMANDS, completing, main, parsers
from tomoslam_stage.exports import FORMATS
from tomoslam_stage.pipeline import pipeline_names
from tomoslam_stage.simulation import PHANTOMS
from tomoslam_stage.stages import STAGES
from tomoslam_stage.studies import STUDIES


@pytest.mark.parametrize("name", [*COMMANDS, ""])
def test_the_help_of_every_command_has_an_example(name: str) -> None:
    said = parsers()[name].format_help()
    assert f"python -m tomoslam_stage {name}".strip() in said.partition("example")[2]


def test_the_words_that_are_completed_are_those_there_are() -> None:
    assert sorted(completing.VALUES["--pipeline"]) == pipeline_names()
    assert set(completing.VALUES["--format"]) == set(FORMATS)
    assert set(completing.VALUES["--phantom"]) == set(PHANTOMS)
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


COMPLETED = {
    "de": "describe",
    "scan.h5 --save": "--save-slices",
    "scan.h5 --pipeline fa": "fast",
    "study err": "error-ratio",
    "simulate out.h5 --phantom gr": "grains",
    "export scan.h5 --format na": "nabu",
    "check st": "stripes",
    "scan.h5 --output sc": "scan.h5",
    "my": "my scan.h5",
}
"""What is typed behind the name of the program -> the last word once the tabulator is pressed."""


def answers(shell: str, script: str, folder: Path) -> str:
    """Run a script of a shell beside two scans, and return what it says."""
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    for name in ("scan.h5", "my scan.h5"):
        (folder / name).touch()
    # Nothing of the user's own set-up takes part.
    own = {"PATH": os.environ["PATH"], "HOME": str(folder), "TERM": "dumb", "LC_ALL": "C"}
    how: dict[str, Any] = {"cwd": folder, "env": own, "capture_output": True, "timeout": 60}
    done = subprocess.run([program, "-c", script], check=False, text=True, **how)
    assert done.stderr == ""
    return done.stdout


def test_bash_completes(tmp_path: Path) -> None:
    script = completing.bash(parsers())
    for typed in COMPLETED:
        words = typed.split()
        script += f"COMP_WORDS=({completing.SCRIPT} {typed}); COMP_CWORD={len(words)}\n"
        script += 'COMPREPLY=(); _tomoslam_stage; printf "%s|" "${COMPREPLY[@]}"; echo\n'
    said = answers("bash", script, tmp_path).splitlines()
    assert said == [f"{word}|" for word in COMPLETED.values()]


def test_fish_completes(tmp_path: Path) -> None:
    script = completing.fish(parsers())
    for typed in COMPLETED:
        script += f"complete --do-complete '{completing.SCRIPT} {typed}'\n"
    said = answers("fish", script, tmp_path).splitlines()
    assert [line.partition("\t")[0] for line in said] == list(COMPLETED.values())


@pytest.mark.parametrize("sourced", [True, False])
def test_zsh_completes(sourced: bool, tmp_path: Path) -> None:
    """A shell of its own is typed into; Ctrl-X says what has become of the line."""
    (tmp_path / f"_{completing.SCRIPT}").write_text(completing.zsh(parsers()))
    source = f"source ./_{completing.SCRIPT}" if sourced else ""
    (tmp_path / ".zshrc").write_text(f"""\
fpath=({tmp_path if not sourced else ""} $fpath); autoload -U compinit; compinit -u -D; {source}
bindkey '^I' complete-word; bindkey '^X' said; zle -N said
said() {{ print -r -- "<<$BUFFER>>"; BUFFER= }}
print '<<ready>>'
""")
    script = "zmodload zsh/zpty; zpty shell zsh -i; zpty -r shell out '*<<ready>>*'\n"
    for typed in COMPLETED:
        script += f"zpty -wn shell $'{completing.SCRIPT} {typed}\\t\\x18'\n"
        script += "zpty -r shell out '*<<*>>*'; print -r -- $out\n"
    said = answers("zsh", script, tmp_path)
    assert "_tomoslam_stage:" not in said
    assert not re.search(r"^_\w+:\d+:", said, re.MULTILINE), said
    lines = re.findall("<<(.*)>>", said)
    wanted = [word.replace(" ", r"\ ") for word in COMPLETED.values()]
    assert [line.rstrip() for line in lines] == [
        f"{completing.SCRIPT} {' '.join([*typed.split()[:-1], word])}"
        for typed, word in zip(COMPLETED, wanted, strict=True)
    ]


def test_an_unknown_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bahs"]) == 2
    assert "Did you mean 'bash'?" in capsys.readouterr().err
