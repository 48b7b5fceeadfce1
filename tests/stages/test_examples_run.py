"""The examples in the docstrings of the public functions are run as they stand."""

from __future__ import annotations

import doctest
import logging
import shutil
from pathlib import Path

import pytest

from tomoslam_stage.scans import nxtomo
from tomoslam_stage.stages import functions

FIXTURE = Path(__file__).parents[2] / "fixtures" / "card_walk_360.h5"


@pytest.mark.parametrize(
    "name", ["load_scan", "refine_theta", "reconstruct", "compare", "write_theta"]
)
def test_the_example_of_a_public_function_runs(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "tomoslam_stage")
    scan = Path(shutil.copy(FIXTURE, tmp_path / "scan.h5"))
    known = {**vars(functions), "SCAN": scan, "COMPANION": tmp_path / "refined.h5"}
    (test,) = doctest.DocTestFinder(recurse=False).find(getattr(functions, name), name, globs=known)
    assert len(test.examples) >= 2
    assert doctest.DocTestRunner().run(test).failed == 0


def test_the_examples_of_the_nexus_layout_run() -> None:
    assert doctest.testmod(nxtomo).failed == 0
