"""refine_theta: Scan -> Refinement, through tracks, angle measurements, factor graph and gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from tomoslam_stage.angles import LoopClosure, Triplets
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.geometry import rms, spread
from tomoslam_stage.heldout import Rows, hold_out
from tomoslam_stage.images import still
from tomoslam_stage.mapping import Mapping
from tomoslam_stage.methods import method
from tomoslam_stage.parallel import on_one_thread
from tomoslam_stage.products import (
    STILL,
    UNKNOWNS,
    AngleMeasurements,
    Floats,
    Geometry,
    Integers,
    Pixels,
    Refinement,
    Scan,
    Tracks,
    Unknown,
    Values,
)
from tomoslam_stage.refinement import (
    FactorGraph,
    Landmarks,
    evidence_of,
    nothing_measured,
    rigidity,
    weigh,
)
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.scans import binned, only
from tomoslam_stage.stages.choosing import Choice
from tomoslam_stage.stages.keyframes import Keyframes
from tomoslam_stage.stages.sources import Outcome, Sources, counted
from tomoslam_stage.stages.triplets import Found, TripletSolver, without_tracks
from tomoslam_stage.stages.work import Clock, SideOutputs, Work, check_axis
from tomoslam_stage.tracks import Tracking

AXIS_ROWS = 5
"""At most so many of the unused rows look for the axis."""


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

    def only(self, projections: Integers) -> Unused:
        """Return the same of some projections, where nothing was judged yet but the axis."""
        scan, axes = only(self.scan, projections), dict(self.axes)
        return Unused(scan, self.rows, self.sinograms[:, projections], axes)

    def keep_recorded(self) -> None:
        """Let the refined angles be the recorded ones."""
        self.axes["refined"] = self.axes["recorded"]
        self.squares["refined"] = self.squares["recorded"]

    def shift_in(self, scan: Scan, shift: Floats | None) -> Floats | None:
        """(n,) px of `scan`: `shift` (n,) in px of these rows; None where they are known."""
        return None if shift is None else self.scan.binning / scan.binning * shift

    def told_in(self, scan: Scan) -> dict[str, Any]:
        """Return the fields of a `Refinement` that tell about these rows, in px of `scan`."""
        columns = {name: self.scan.column_in_file(axis) for name, axis in self.axes.items()}
        return {
            "axes": {name: scan.column_from_file(column) for name, column in columns.items()},
            "reprojection": {name: np.sqrt(s.mean(axis=0)) for name, s in self.squares.items()},
            "heldout_rows": self.rows * self.scan.binning // scan.binning,
        }


class Refined(NamedTuple):
    """What `RefineTheta` came to."""

    refinement: Refinement
    tracks: Tracks | None
    """Of the features it used, px of the scan; None where there are none."""


def known_unknowns(names: Any) -> Any:
    """Check the names of what is unknown.

    Raises
    ------
    PipelineError
        For one that is not there, and where the angles are not among them.
    """
    where = "refine_theta.unknowns"
    if isinstance(names, str) or not isinstance(names, Sequence):
        return names
    for name in names:
        if name not in UNKNOWNS:
            raise PipelineError(where, f"no unknown {name!r}.", nearest(str(name), UNKNOWNS))
    if "theta" not in names:
        found = f"{list(names)}; theta is needed, as it is what is refined."
        raise PipelineError(where, found, "Add it.")
    return tuple(name for name in UNKNOWNS if name in names)


@method
class RefineTheta:
    """Refine the recorded angles, and say whether the refined ones stand."""

    needs: ClassVar = ("scan",)
    makes: ClassVar = ("refinement",)
    gives: ClassVar = ("status", "axis")
    leaves: ClassVar[tuple[Values, ...]] = ("line_integrals",)

    axis: float | None = None
    """Detector column of the rotation axis, px of the file; looked for where not given."""
    unknowns: Annotated[tuple[Unknown, ...], BeforeValidator(known_unknowns)] = STILL
    """What is solved for: ``theta`` and, where named, ``axis`` and ``roll`` (else held where they
    were found, and at none) and ``shift``, a column shift of each projection, for samples that
    moved on the stage."""
    width: Annotated[int, Field(ge=64)] = 640
    """Wider scans are binned until they have at most so many columns."""
    keyframes: Annotated[int, Field(ge=100)] | None = 1500
    """Of longer scans so many projections are solved for together, spread over the scan, and the
    others placed in the map they make, which bounds memory and time; null: all together. Where
    only triplets are measured all are solved for, as these tie neighbours alone."""
    rounds: Annotated[int, Field(ge=1)] = 4
    """At most so many rounds of measuring triplets, or of growing tracks, and solving the graph."""
    settled_deg: Annotated[float, Field(gt=0)] = 0.01
    """Angles that change less than this in a round have settled, degrees."""
    tracks: Tracking = field(default_factory=Tracking)
    """How features are found and followed."""
    angles: Triplets | None = None
    """How the steps between projections are measured in triplets; null: not at all."""
    closures: LoopClosure | None = None
    """How projections are compared with those of half a turn and a full turn before; null: not."""
    landmarks: Landmarks | None = field(default_factory=Landmarks)
    """How features are placed together with the angles; null: not at all."""
    mapping: Mapping | None = field(default_factory=Mapping)
    """How the reconstruction itself tells the angles; null: not at all."""
    closer: Mapping | None = field(default_factory=Mapping.closer)
    """How it looks again where projections do not fit (`choice.suspect_excess`); null: not."""
    choice: Choice = field(default_factory=Choice)
    """Which of these is believed."""
    refinement: FactorGraph = field(default_factory=FactorGraph)
    """How everything measured, and the recorded steps, become angles, and when these stand."""
    reprojection: Reprojection = field(default_factory=Reprojection)
    """How angles and axis are judged on rows that were not used."""

    def __post_init__(self) -> None:
        if self.angles is None and self.landmarks is None and self.mapping is None:
            found = "angles, landmarks and mapping are all null; one of them is needed."
            raise PipelineError("refine_theta", found)
        still_only = {
            "angles measures triplets": self.angles,
            "closures compares projections": self.closures,
        }
        for does, how in still_only.items():
            if "shift" in self.unknowns and how is not None:
                found = f"shift is unknown, and {does}, which take the sample for still."
                raise PipelineError("refine_theta.unknowns", found, "Leave one of them out.")

    def run(self, work: Work) -> SideOutputs:
        """Leave the refinement."""
        clock = Clock(work.seconds)
        work.refinement, work.tracks = self.refined(work.line_integrals(), clock)
        return {"status": work.refinement.status, "axis": work.refinement.axis}

    def check_fits(self, scan: Scan) -> None:
        """Refuse an axis that the detector does not have."""
        check_axis("refine_theta.axis", self.axis, scan)

    def refine(self, scan: Scan, clock: Clock) -> Refinement:
        """Refine the angles of `scan`; `clock` hears how long each station takes."""
        return self.refined(scan, clock).refinement

    def refined(self, scan: Scan, clock: Clock) -> Refined:
        """Do what `refine` does, and show the tracks, too."""
        self.check_fits(scan)
        with on_one_thread():
            return self._refined(scan, clock)

    def _refined(self, scan: Scan, clock: Clock) -> Refined:
        small = binned(scan, -(-scan.n_columns // self.width))
        rows = hold_out(small)
        unused = Unused(small, rows.heldout, small.sinograms(rows.heldout))
        with clock("axis"):
            self._judge("recorded", scan.theta, unused)
        if self.landmarks is None and self.mapping is None:
            return self._by_triplets(scan, rows, unused, clock)
        return self._by_sources(scan, rows, unused, clock)

    def _judge(self, name: str, theta: Floats, unused: Unused, shift: Floats | None = None) -> None:
        """Reproject the unused rows with `theta`, `shift` and the axis that suits them best."""
        judge, sinograms = self.reprojection, still(unused.sinograms, shift)
        few = sinograms[:: -(-len(sinograms) // AXIS_ROWS)]
        if self.axis is not None:
            axis = unused.scan.column_from_file(self.axis)
        elif unused.axes and "axis" not in self.unknowns:
            axis = unused.axes["recorded"]
        elif unused.axes:
            axis = judge.best_axis(few, theta, unused.axes["recorded"], step=0.5)
        else:
            axis = judge.find_axis(few, theta)
        unused.axes[name] = axis
        unused.squares[name] = judge.squares(sinograms, theta, axis)

    def _by_triplets(self, scan: Scan, rows: Rows, unused: Unused, clock: Clock) -> Refined:
        """Refine as the paper does."""
        small, axis = unused.scan, unused.axes["recorded"]
        with clock("tracks"):
            tracks = self.tracks.track(small, axis, rows.usable)
        besides = without_tracks(self.closures, small, rows, Geometry(scan.theta, axis), clock)
        with clock("triplets"):
            found = self.turns(besides).found(tracks, scan.theta, axis, small.n_rows)
        shown = tracks_in(scan, small, tracks) if tracks.n_sightings else None
        with clock("gate"):
            if not found.measurements.n_measured:
                return Refined(unmeasured(scan, found, unused), shown)
            self._judge("refined", found.solution.theta, unused)
            return Refined(self._judged(scan, found, unused), shown)

    def turns(self, besides: AngleMeasurements) -> TripletSolver:
        """Return what measures triplets and solves the graph; `besides` is known without them."""
        angles = self.angles or Triplets()
        return TripletSolver(angles, self.refinement, self.rounds, self.settled_deg, besides)

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

    def _by_sources(self, scan: Scan, rows: Rows, unused: Unused, clock: Clock) -> Refined:
        """Refine with features as landmarks, the map, or both, in one graph."""
        small = unused.scan
        start = Geometry(
            scan.theta,
            unused.axes["recorded"],
            middle=(small.n_rows - 1) / 2,
            unknowns=self.unknowns,
        )
        keys = spread(small.n_projections, self.keyframes or small.n_projections)
        if len(keys) == small.n_projections:
            outcome = self._asked(unused, rows, start, clock)
        else:
            outcome = self._by_keyframes(keys, unused, rows, start, clock)
        tracks = None if outcome.tracks is None else tracks_in(scan, small, outcome.tracks)
        with clock("gate"):
            return Refined(self._weighed(scan, outcome, unused), tracks)

    def _by_keyframes(
        self, keys: Integers, unused: Unused, rows: Rows, start: Geometry, clock: Clock
    ) -> Outcome:
        """Ask about the projections `keys`, and place the others in what these make."""
        some = unused.only(keys)
        first = replace(start, theta=start.theta[keys], shift=np.empty(0))
        outcome = self._asked(some, rows, first, clock)
        with clock("placing"):
            outcome = Keyframes(unused.scan, start, keys, self.refinement).completed(outcome)
        # The axis of the recorded angles was looked for with all projections.
        unused.axes.update({**some.axes, **unused.axes})
        return outcome

    def _asked(self, unused: Unused, rows: Rows, start: Geometry, clock: Clock) -> Outcome:
        """Ask all sources about the projections of `unused`."""

        def judge(name: str, geometry: Geometry) -> Floats:
            if name not in unused.squares:
                self._judge(name, geometry.theta, unused, geometry.shift)
            return unused.squares[name]

        return Sources(self).ask(unused.scan, rows, start, judge, clock)

    def _weighed(self, scan: Scan, outcome: Outcome, unused: Unused) -> Refinement:
        """Let the gate judge what the sources came to."""
        if outcome.fused is None:
            return unanswered(scan, outcome, unused)
        fused, recorded = outcome.fused, scan.theta
        theta = fused.geometry.theta
        self._judge("refined", theta, unused, fused.geometry.shift)
        change = float(np.std(theta - recorded))
        errors = fused.half_error, float(np.sqrt(max(change**2 - fused.half_error**2, 0.0)))
        how = self.landmarks or Landmarks()
        evidence = replace(
            evidence_of(recorded, errors, 1.0, unused.squares),
            sigma_deg=float(np.rad2deg(rms(fused.sigma))),
            rigidity=None
            if outcome.tracks is None
            else rigidity(outcome.tracks, fused.geometry, how, unused.scan.binning),
        )
        verdict = self.refinement.gate.judge(evidence)
        return Refinement(
            recorded=recorded,
            refined=theta,
            sigma=fused.sigma,
            status=verdict.status,
            reason=verdict.reason,
            evidence=evidence,
            residuals=fused.residuals,
            sources=outcome.sources,
            counts=outcome.counts,
            # Where the angles do not stand, neither do the lapses that they show.
            events=outcome.events if verdict.status == "accepted" else (),
            roll=fused.geometry.roll,
            unknowns=self.unknowns,
            shift=unused.shift_in(scan, fused.shift),
            shift_sigma=unused.shift_in(scan, fused.shift_sigma),
            stage_noise=outcome.noise,
            histograms=outcome.histograms,
            **unused.told_in(scan),
        )


def tracks_in(scan: Scan, small: Scan, tracks: Tracks) -> Tracks:
    """Tell tracks in px of `scan` that were followed in `small`, the same scan binned."""
    pixel = small.binning / scan.binning
    # Centres of pixels lie on whole numbers, so the first centre moves by half of what was added.
    column, row = (places * pixel + (pixel - 1) / 2 for places in (tracks.column, tracks.row))
    return replace(tracks, column=column, row=row)


def unanswered(scan: Scan, outcome: Outcome, unused: Unused) -> Refinement:
    """Keep the recorded angles of a scan about which no source says anything."""
    unused.keep_recorded()
    return Refinement(
        recorded=scan.theta,
        refined=scan.theta,
        sigma=np.full(len(scan.theta), np.nan),
        status="kept",
        reason="; ".join(f"{name} {note}" for name, note in outcome.sources.items()),
        sources=outcome.sources,
        counts=outcome.counts,
        histograms=outcome.histograms,
        **unused.told_in(scan),
    )


def unmeasured(scan: Scan, found: Found, unused: Unused) -> Refinement:
    """Keep the recorded angles of a scan whose features say nothing about them."""
    verdict = nothing_measured(found.tracks, found.measurements)
    unused.keep_recorded()
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
        **counted(tracks),
        "triplets measured": measurements.n_measured,
        **{f"triplets failed: {why}": count for why, count in measurements.failures.items()},
    }
