"""All studies, run once on a small simulated scan."""

from __future__ import annotations

import json
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from tomoslam_stage.cli import main


@dataclass(frozen=True)
class Called:
    """What a call of ``study`` left behind."""

    code: int
    out: str
    err: str
    folder: Path

    def facts(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.folder / f"{name}.json").read_text())
        return found


def called(folder: Path, *words: object) -> Called:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(["study", *map(str, words), "--output", str(folder)])
    return Called(code, out.getvalue(), err.getvalue(), folder)


@pytest.fixture(scope="session")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Called:
    """``study all --fast``."""
    return called(tmp_path_factory.mktemp("studies") / "out", "all", "--fast")
