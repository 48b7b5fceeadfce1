"""Turns of measuring and solving: which of them counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements, Floats, Tracks
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.triplets import TripletSolver

TURN = "turn"
RECORDED = np.linspace(0, 3, 7)
NONE = np.empty(0, np.intp)
TRACKS = Tracks(NONE, NONE, np.empty(0), np.empty(0), np.zeros(7, np.intp))


class StandIn:
    """Stands in for angles and refinement: each turn moves one angle as far as it was told to."""

    def __init__(self, moves_deg: Sequence[float]) -> None:
        self.moves = iter(moves_deg)
        self.expected: list[Floats] = []
        self.solved: list[SimpleNamespace] = []

    def measure(self, tracks: Tracks, theta: Floats, axis: float) -> AngleMeasurements:
        """Return measurements of nothing, with the number of the turn."""
        assert tracks is TRACKS
        assert axis == 31.5
        self.expected.append(theta)
        return replace(AngleMeasurements.none(), failures={TURN: len(self.expected)})

    def solve(self, recorded: Floats, measured: AngleMeasurements) -> SimpleNamespace:
        """Move the fourth angle from where it was expected."""
        np.testing.assert_array_equal(recorded, RECORDED)
        assert measured.failures[TURN] == len(self.expected)
        theta = self.expected[-1].copy()
        theta[3] += np.deg2rad(next(self.moves))
        self.solved.append(SimpleNamespace(theta=theta))
        return self.solved[-1]


def said(moves_deg: Sequence[float], **parameters: float) -> tuple[int, int]:
    """Return the number of the turn that counts, and how many there were."""
    stand_in = StandIn(moves_deg)
    real = RefineTheta(**parameters)
    solver = TripletSolver(stand_in, stand_in, real.rounds, real.settled_deg)
    measured, solution = solver.said(TRACKS, RECORDED, 31.5)
    turn = measured.failures[TURN]
    assert solution is stand_in.solved[turn - 1]
    np.testing.assert_array_equal(stand_in.expected[0], RECORDED)
    for expected, before in zip(stand_in.expected[1:], stand_in.solved, strict=False):
        np.testing.assert_array_equal(expected, before.theta)
    return turn, len(stand_in.solved)


@pytest.mark.parametrize(
    ("moves_deg", "counts", "turns"),
    [
        ([1.0, 2.0], 1, 2),
        ([1.0, -1.5], 1, 2),
        ([1.0, 0.5, 1.2], 1, 3),
        ([1.0, 0.5, 0.25, 1.0], 1, 4),
    ],
)
def test_the_first_turn_counts_where_turns_lead_further_and_further_away(
    moves_deg: list[float], counts: int, turns: int
) -> None:
    assert said(moves_deg) == (counts, turns)


@pytest.mark.parametrize(
    ("moves_deg", "turns"),
    [([0.005], 1), ([1.0, -0.005], 2), ([1.0, 0.5, 0.009], 3), ([1.0, 0.5, 0.7, 0.009], 4)],
)
def test_the_last_turn_counts_where_turns_settle(moves_deg: list[float], turns: int) -> None:
    assert said(moves_deg) == (turns, turns)


def test_there_are_as_many_turns_as_allowed_and_they_settle_where_asked() -> None:
    assert said([1.0, 0.5], rounds=2) == (2, 2)
    assert said([1.0, 0.5], rounds=1) == (1, 1)
    assert said([1.0, 0.5], settled_deg=0.6) == (2, 2)
