"""refine_theta: Scan -> Refinement, through tracks, angle measurements, factor graph and gate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from tomoslam_stage.angles import Triplets
from tomoslam_stage.heldout import Rows, hold_out
from tomoslam_stage.methods import method
from tomoslam_stage.products import (
    AngleMeasurements,
    Floats,
    Integers,
    Pixels,
    Refinement,
    Scan,
    Tracks,
    Values,
)
from tomoslam_stage.refinement import FactorGraph, Halves, Solution, nothing_measured, weigh
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.scans import binned
from tomoslam_stage.stages.work import Clock, SideOutputs, Work, check_axis
from tomoslam_stage.tracks import Tracking, halves

AXIS_ROWS = 5
"""At most so many of the unused rows look for the axis."""


@dataclass(frozen=True)
class Found:
    """What the features of a scan say."""

    tracks: Tracks
    measurements: AngleMeasurements
    solution: Solution
    halves: Halves
    """Its angles again, and those of either half of the tracks."""


@dataclass(frozen=True)
class Unused:
    """Rows that judge the angles, and how well they reproject with each."""

    scan: Scan
    """The scan as it is worked on: binned."""
    rows: Integers
    """(r,) of that scan."""
    sinograms: Pixels
    """(r, n, column)"""
    axes: dict[str, float] = field(default_factory=dict)
    """By name of the angles: the axis that suits them best, px."""
    squares: dict[str, Floats] = field(default_factory=dict)
    """By name of the angles: (r, n) mean squared residual."""

    def told_in(self, scan: Scan) -> dict[str, Any]:
        """Return the fields of a `Refinement` that tell about these rows, in px of `scan`."""
        columns = {name: self.scan.column_in_file(axis) for name, axis in self.axes.items()}
        return {
            "axes": {name: scan.column_from_file(column) for name, column in columns.items()},
            "reprojection": {name: np.sqrt(s.mean(axis=0)) for name, s in self.squares.items()},
            "heldout_rows": self.rows * self.scan.binning // scan.binning,
        }


@method
class RefineTheta:
    """Refine the recorded angles, and say whether the refined ones stand."""

    needs: ClassVar = ("scan",)
    makes: ClassVar = ("refinement",)
    gives: ClassVar = ("status", "axis")
    leaves: ClassVar[tuple[Values, ...]] = ("line_integrals",)

    axis: float | None = None
    """Detector column of the rotation axis, px of the file; looked for where not given."""
    width: Annotated[int, Field(ge=64)] = 640
    """Wider scans are binned until they have at most so many columns."""
    rounds: Annotated[int, Field(ge=1)] = 4
    """At most so many rounds of measuring triplets and solving the graph."""
    settled_deg: Annotated[float, Field(gt=0)] = 0.01
    """Angles that change less than this in a round have settled, degrees."""
    tracks: Tracking = field(default_factory=Tracking)
    """How features are found and followed."""
    angles: Triplets = field(default_factory=Triplets)
    """How the steps between projections are measured."""
    refinement: FactorGraph = field(default_factory=FactorGraph)
    """How measured and recorded steps become angles, and when these stand."""
    reprojection: Reprojection = field(default_factory=Reprojection)
    """How angles and axis are judged on rows that were not used."""

    def run(self, work: Work) -> SideOutputs:
        """Leave the refinement."""
        work.refinement = self.refine(work.line_integrals(), Clock(work.seconds))
        return {"status": work.refinement.status, "axis": work.refinement.axis}

    def check_fits(self, scan: Scan) -> None:
        """Refuse an axis that the detector does not have."""
        check_axis("refine_theta.axis", self.axis, scan)

    def refine(self, scan: Scan, clock: Clock) -> Refinement:
        """Refine the angles of `scan`; `clock` hears how long each station takes."""
        self.check_fits(scan)
        small = binned(scan, -(-scan.n_columns // self.width))
        rows = hold_out(small)
        unused = Unused(small, rows.heldout, small.sinograms(rows.heldout))
        with clock("axis"):
            self._judge("recorded", scan.theta, unused)
        found = self._found(small, unused.axes["recorded"], rows, clock)
        with clock("gate"):
            if not found.measurements.n_measured:
                return unmeasured(scan, found, unused)
            self._judge("refined", found.solution.theta, unused)
            return self._judged(scan, found, unused)

    def _judge(self, name: str, theta: Floats, unused: Unused) -> None:
        """Reproject the unused rows with `theta` and the axis that suits it best."""
        judge, sinograms = self.reprojection, unused.sinograms
        few = sinograms[:: -(-len(sinograms) // AXIS_ROWS)]
        if self.axis is not None:
            axis = unused.scan.column_from_file(self.axis)
        elif unused.axes:
            axis = judge.best_axis(few, theta, unused.axes["recorded"], step=0.5)
        else:
            axis = judge.find_axis(few, theta)
        unused.axes[name] = axis
        unused.squares[name] = judge.squares(sinograms, theta, axis)

    def _found(self, scan: Scan, axis: float, rows: Rows, clock: Clock) -> Found:
        """Ask all tracks, and either half of them."""
        with clock("tracks"):
            tracks = self.tracks.track(scan, axis, rows.usable)
        parts = (tracks, *halves(tracks, scan.n_rows))
        said = [self._said(part, scan.theta, axis, clock) for part in parts]
        measurements, solution = said[0]
        counted = [measured.n_measured for measured, _ in said]
        poorer = min(counted[1:]) / max(counted[0], 1)
        whole, first, second = (solved.theta for _, solved in said)
        halved = Halves(whole, first, second, measured=poorer)
        return Found(tracks, measurements, solution, halved)

    def _said(
        self, tracks: Tracks, recorded: Floats, axis: float, clock: Clock
    ) -> tuple[AngleMeasurements, Solution]:
        """Measure and solve in turns: better angles tell better what a triplet should look like.

        Where the turns lead further and further away, the tracks are no good; the first counts.
        """
        said: list[tuple[AngleMeasurements, Solution]] = []
        changes: list[float] = []
        expected = recorded
        for _ in range(self.rounds):
            with clock("angles"):
                measurements = self.angles.measure(tracks, expected, axis)
            with clock("graph"):
                solution = self.refinement.solve(recorded, measurements)
            said.append((measurements, solution))
            changes.append(float(np.rad2deg(np.abs(solution.theta - expected).max())))
            if len(changes) > 1 and changes[-1] >= changes[0]:
                return said[0]
            if changes[-1] < self.settled_deg:
                break
            expected = solution.theta
        return said[-1]

    def _judged(self, scan: Scan, found: Found, unused: Unused) -> Refinement:
        evidence = weigh(scan.theta, found.halves, unused.squares)
        verdict = self.refinement.gate.judge(evidence)
        sigma = found.solution.sigma
        return Refinement(
            recorded=scan.theta,
            refined=found.solution.theta,
            sigma=sigma * found.halves.excess(sigma),
            status=verdict.status,
            reason=verdict.reason,
            evidence=evidence,
            residuals=found.solution.residuals,
            counts=counts(found),
            **unused.told_in(scan),
        )


def unmeasured(scan: Scan, found: Found, unused: Unused) -> Refinement:
    """Keep the recorded angles of a scan whose features say nothing about them."""
    verdict = nothing_measured(found.tracks, found.measurements)
    unused.axes["refined"] = unused.axes["recorded"]
    unused.squares["refined"] = unused.squares["recorded"]
    return Refinement(
        recorded=scan.theta,
        refined=scan.theta,
        sigma=found.solution.sigma,
        status=verdict.status,
        reason=verdict.reason,
        counts=counts(found),
        **unused.told_in(scan),
    )


def counts(found: Found) -> dict[str, int]:
    """Numbers for the report; of triplets that gave no measurement, how many for which reason."""
    tracks, measurements = found.tracks, found.measurements
    return {
        "keypoints": int(tracks.keypoints.sum()),
        "fixed to the detector": tracks.fixed_to_detector,
        "features": tracks.n_features,
        "sightings": tracks.n_sightings,
        "triplets measured": measurements.n_measured,
        **{f"triplets failed: {why}": count for why, count in measurements.failures.items()},
    }
