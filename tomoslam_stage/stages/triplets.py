"""The published way to refined angles: tracks, triplets, one graph of encoder and CV factors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tomoslam_stage.angles import LoopClosure, Triplets
from tomoslam_stage.geometry import spread
from tomoslam_stage.heldout import Rows
from tomoslam_stage.products import AngleMeasurements, Floats, Geometry, Scan, Tracks
from tomoslam_stage.refinement import FactorGraph, Halves, Solution
from tomoslam_stage.stages.work import Clock
from tomoslam_stage.tracks import halves


@dataclass(frozen=True)
class Found:
    """What the features of a scan say."""

    tracks: Tracks
    measurements: AngleMeasurements
    solution: Solution
    halves: Halves
    """Its angles again, and those of either half of the tracks."""


@dataclass(frozen=True)
class TripletSolver:
    """Measures triplets and solves the graph, in turns."""

    angles: Triplets
    graph: FactorGraph
    rounds: int
    settled_deg: float
    besides: AngleMeasurements = field(default_factory=AngleMeasurements.none)
    """What does not depend on tracks: where loops close, and which way the stage went."""

    def found(self, tracks: Tracks, recorded: Floats, axis: float, n_rows: int) -> Found:
        """Ask all tracks, and either half of them."""
        parts = (tracks, *halves(tracks, n_rows))
        said = [self.said(part, recorded, axis) for part in parts]
        measurements, solution = said[0]
        counted = [measured.n_measured for measured, _ in said]
        poorer = min(counted[1:]) / max(counted[0], 1)
        whole, first, second = (solved.theta for _, solved in said)
        halved = Halves(whole, first, second, measured=poorer)
        return Found(tracks, measurements, solution, halved)

    def said(
        self, tracks: Tracks, recorded: Floats, axis: float
    ) -> tuple[AngleMeasurements, Solution]:
        """Measure and solve in turns: better angles tell better what a triplet should look like.

        Where the turns lead further and further away, the tracks are no good; the first counts.
        """
        said: list[tuple[AngleMeasurements, Solution]] = []
        changes: list[float] = []
        expected = recorded
        for _ in range(self.rounds):
            triplets = self.angles.measure(tracks, expected, axis)
            measurements = self.besides.joined(triplets)
            solution = self.graph.solve(recorded, measurements)
            said.append((measurements, solution))
            changes.append(float(np.rad2deg(np.abs(solution.theta - expected).max())))
            if len(changes) > 1 and changes[-1] >= changes[0]:
                return said[0]
            if changes[-1] < self.settled_deg:
                break
            expected = solution.theta
        return said[-1]


def without_tracks(
    how: LoopClosure | None, scan: Scan, rows: Rows, start: Geometry, clock: Clock
) -> AngleMeasurements:
    """Return what needs no tracks: loops closed, if asked, on rows that may be used."""
    nothing = replace(AngleMeasurements.none(), stage_steps=scan.stage_steps)
    if how is None:
        return nothing
    with clock("closures"):
        usable = np.flatnonzero(rows.usable)
        some = usable[spread(len(usable), how.rows)]
        loops = how.measure(scan.sinograms(some), start.theta, start.axis)
        return replace(nothing, closures=loops)
