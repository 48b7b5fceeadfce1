from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.comparison import Findings, Run, report, summary
from tomoslam_stage.comparison.sparkline import ASCII, BLOCKS, WIDTH, sparkline


@pytest.mark.parametrize("levels", [BLOCKS, ASCII])
def test_a_ramp_climbs_through_all_levels(levels: str) -> None:
    assert sparkline(np.arange(8.0), levels) == levels
    assert sparkline(np.arange(8.0)[::-1], levels) == levels[::-1]


def test_long_curves_are_averaged_and_short_ones_are_not_stretched() -> None:
    drawn = sparkline(np.repeat(np.arange(8.0), 600))
    assert len(drawn) == WIDTH
    assert sorted(set(drawn)) == sorted(BLOCKS)
    assert len(sparkline(np.zeros(3))) == 3


def test_what_is_not_known_is_blank() -> None:
    assert sparkline(np.array([0.0, np.nan, 7.0])) == f"{BLOCKS[0]} {BLOCKS[-1]}"
    assert sparkline(np.full(3, np.nan)) == "   "
    assert sparkline(np.empty(0)) == ""


def test_a_terminal_without_blocks_gets_the_same_in_ascii(findings: Findings, run: Run) -> None:
    made = report(findings, run)
    with_blocks, plain = summary(made), summary(made, unicode=False)
    assert plain.isascii()
    assert set(BLOCKS) & set(with_blocks)
    assert len(with_blocks.splitlines()) == len(plain.splitlines())
    assert "deg rms" in plain.splitlines()[-1]


def test_the_summary_ends_with_the_line_for_the_logbook(findings: Findings) -> None:
    made = report(findings, Run(started="2024-05-03T09:12:44+00:00"))
    line = summary(made).splitlines()[-1]
    assert line == made["logbook_line"]
    assert line.startswith("2024-05-03 09:12 UTC tomoslam_stage")
    assert "a$b$.h5: refined angles accepted: reprojection residual" in line
    assert "90 projections · correction " in line
    assert "median σ 0.02°" in line
