"""Features as landmarks and the map, asked one after the other and joined in one graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.heldout import Rows
from tomoslam_stage.mapping import Made, Mapped
from tomoslam_stage.mapping import Mapping as MapFactor
from tomoslam_stage.products import (
    AngleMeasurements,
    Event,
    Floats,
    Geometry,
    Integers,
    Scan,
    Solve,
    StageNoise,
    Tracks,
)
from tomoslam_stage.refinement import (
    FactorGraph,
    Fused,
    Landmarks,
    Said,
    as_one,
    fused,
    honest,
    lapses,
    solver_with,
    with_stage_noise,
)
from tomoslam_stage.stages.choosing import FEATURES, MAP, RECORDED, USED, falls
from tomoslam_stage.stages.landmarks import FEWEST, Placed, Turns
from tomoslam_stage.stages.triplets import without_tracks
from tomoslam_stage.stages.work import Clock
from tomoslam_stage.tracks import Seen, halves

if TYPE_CHECKING:
    from tomoslam_stage.stages.refining import RefineTheta

CLOSE_COLUMNS = 400
"""Wider scans are binned as usual when they are looked at more closely: it would take minutes."""

Judge = Callable[[str, Geometry], Floats]
"""Reproject rows that were not used with the angles, and the shifts, of this name: (r, n) mean
squared residual. The axis that suits them best is looked for."""


@dataclass(frozen=True)
class Outcome:
    """What all sources together came to."""

    fused: Fused | None
    """None where no source said anything."""
    sources: Mapping[str, str]
    """By name: that it was used, or why not."""
    events: tuple[Event, ...] = ()
    """Lapses of the rotation stage."""
    noise: StageNoise | None = None
    """Its usual error."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Numbers for the report."""
    histograms: Mapping[str, Floats] = field(default_factory=dict)
    """What the report draws histograms of, see `Refinement`."""
    tracks: Tracks | None = None
    """Of the features that were placed, px of the binned scan."""
    made: Made | None = None
    """How the map was made, where it is believed."""


@dataclass
class Heard:
    """What the sources have said so far."""

    judge: Judge
    """Reprojects rows that were not used."""
    begin: Geometry
    """Where unused rows reproject best so far."""
    graph: FactorGraph
    """What the pipeline asks for, with the stage as it looks from there."""
    squares: dict[str, Floats] = field(default_factory=dict)
    """By name of the angles: (r, n) mean squared residual on unused rows."""
    said: dict[str, Said] = field(default_factory=dict)
    """By name of the source."""
    notes: dict[str, str] = field(default_factory=dict)
    """By name of the source: why it says nothing."""
    counts: dict[str, int] = field(default_factory=dict)
    """For the report."""
    histograms: dict[str, Floats] = field(default_factory=dict)
    """For the report, too."""
    tracks: Tracks | None = None
    """For the report, too."""
    made: Made | None = None
    """How the map was made."""
    excess: float = 1.0
    """Residual of the worst projection in the map's account, in units of the usual one."""
    suspect: bool = False
    """Whether that is too much: what misleads the map there may mislead all."""

    def hear(self, name: str, said: Said, ended: Geometry) -> None:
        """Take what a source said, and how well unused rows reproject where it `ended`."""
        self.said[name] = said
        self.squares[name] = self.judge(name, ended)

    def for_report(self) -> dict[str, Any]:
        """Return the fields of an `Outcome` that only the report reads."""
        return {"counts": self.counts, "histograms": self.histograms, "tracks": self.tracks}


@dataclass(frozen=True)
class Sources:
    """What is asked for the angles of a scan, and how."""

    how: RefineTheta
    """What the pipeline says."""

    def ask(self, scan: Scan, rows: Rows, start: Geometry, judge: Judge, clock: Clock) -> Outcome:
        """Ask each source on its own, then join those that are believed.

        Parameters
        ----------
        scan
            Binned as it is worked on.
        rows
            Which of its rows may be used.
        start
            The recorded angles, and the axis that suits them.
        judge
            Tells how well rows that were not used reproject; they decide, and measure nothing.
        clock
            Hears how long each station takes.
        """
        heard = Heard(judge, start, self.how.refinement, {RECORDED: judge(RECORDED, start)})
        measurements = self._ask_tracks(heard, scan, rows, start, clock)
        if self.how.mapping is not None:
            solve = solver_with(heard.graph, start, measurements)
            with clock(MAP):
                self._ask_map(heard, scan, np.flatnonzero(rows.usable), solve)
        with clock("graph"):
            return self._joined(heard, start, measurements)

    def _ask_tracks(
        self, heard: Heard, scan: Scan, rows: Rows, start: Geometry, clock: Clock
    ) -> AngleMeasurements:
        """Follow features, measure triplets, and place the features; return what is measured.

        The keypoints, which take much memory, are not kept.
        """
        how = self.how
        measurements = without_tracks(how.closures, scan, rows, start, clock)
        heard.counts |= {"loops closed": len(measurements.closures)} if how.closures else {}
        if how.landmarks is None and how.angles is None:
            return measurements
        with clock("tracks"):
            seen = how.tracks.see(scan, start.axis, rows.usable)
        heard.counts |= counted(seen.tracks)
        if how.angles is not None:
            with clock("triplets"):
                turns = how.turns(measurements)
                measurements, _ = turns.said(seen.tracks, start.theta, start.axis)
            heard.counts["triplets measured"] = measurements.n_measured
        if how.landmarks is not None:
            with clock(FEATURES):
                self._ask_features(heard, seen, scan.n_rows, start, measurements)
        return measurements

    def _ask_features(
        self,
        heard: Heard,
        seen: Seen,
        n_rows: int,
        start: Geometry,
        measurements: AngleMeasurements,
    ) -> None:
        """Place the features, all of them and either half."""
        how, landmarks = self.how, self.how.landmarks or Landmarks()
        solve = solver_with(how.refinement, start, measurements)
        turns = Turns(how.tracks, landmarks, how.rounds, how.settled_deg)
        whole = turns.placed(seen, start, solve)
        if whole is None:
            followed = seen.tracks.sighted(how.tracks.growing.fewest).n_features
            why = f"left out: {followed} features could be followed; {FEWEST} are needed"
            heard.notes[FEATURES] = why
            return
        parts = halves(whole.tracks, n_rows)
        fewest = min(part.n_features for part in parts)
        if fewest < FEWEST // 2:
            why = f"left out: half of the features are {fewest}; {FEWEST // 2} are needed"
            heard.notes[FEATURES] = why
            return
        heard.counts |= counted(whole.tracks)
        heard.histograms |= drawn(whole)
        heard.tracks = whole.tracks
        ended, quadratic = whole.adjusted.geometry, whole.adjusted.quadratic()
        ends = [landmarks.adjust(half, ended, solve) for half in parts]
        apart = ends[0].geometry.since(ends[1].geometry)
        said = Said(
            geometry=ended,
            quadratic=quadratic,
            # Each half has half of the information; its pull leads to where it ended.
            halves=quadratic.information @ apart / 2,
            biases=np.zeros((0, len(apart))),
        )
        found, noise = self._with_stage_noise(start, measurements, [said])
        heard.hear(FEATURES, said, found.geometry)
        if falls(heard.squares, FEATURES, RECORDED, start.theta):
            heard.begin = found.geometry
            if noise is not None:
                heard.graph = how.refinement.informed(noise)

    def _ask_map(self, heard: Heard, scan: Scan, usable: Integers, solve: Solve) -> None:
        """Let the reconstruction correct the angles."""
        mapping, suspect = self.how.mapping or MapFactor(), self.how.choice.suspect_excess
        mapped = mapping.refine(scan, usable, heard.begin, solve)
        if self.how.closer and mapped is not None and mapped.excess > suspect:
            narrow = scan.n_columns <= CLOSE_COLUMNS
            closer = self.how.closer
            closer = closer if narrow else replace(closer, binning=mapping.binning)
            mapped = closer.refine(scan, usable, heard.begin, solve) or mapped
        if mapped is None:
            asked = f"{len(usable)} rows of {scan.n_projections} projections"
            heard.notes[MAP] = f"left out: {asked} say nothing about the angles"
            return
        heard.excess, heard.suspect = mapped.excess, mapped.excess > suspect
        heard.made = mapped.made
        heard.counts["map rows"] = len(mapped.row_pulls)
        heard.hear(MAP, said_by(mapped, suspect), mapped.geometry)

    def _joined(self, heard: Heard, recorded: Geometry, measurements: AngleMeasurements) -> Outcome:
        """Choose among the sources, and solve the graph with those that are believed."""
        alone = {
            name: fused(self.how.refinement, recorded, measurements, [said])
            for name, said in heard.said.items()
        }
        chosen = self.how.choice.of(alone, heard.excess, heard.squares, recorded.theta)
        notes = {**heard.notes, **chosen}
        # What they said takes much memory, and is not asked for again.
        used = [
            honest(heard.said.pop(name), alone[name])
            for name, note in chosen.items()
            if note == USED
        ]
        if not used:
            return Outcome(None, notes, **heard.for_report())
        if heard.suspect:
            used = as_one(used)
        joint, noise = self._with_stage_noise(recorded, measurements, used)
        correction = joint.geometry.theta - recorded.theta
        steps = measurements.stage_steps
        events = lapses(recorded.theta, correction, joint.step_variances, steps)
        made = heard.made if chosen.get(MAP) == USED else None
        return Outcome(joint, notes, events, noise, made=made, **heard.for_report())

    def _with_stage_noise(
        self, recorded: Geometry, measurements: AngleMeasurements, said: Sequence[Said]
    ) -> tuple[Fused, StageNoise | None]:
        """Solve the graph with the noise of the stage that all that was `said` shows."""

        def solved(graph: FactorGraph) -> Fused:
            return fused(graph, recorded, measurements, said)

        how, steps = self.how.refinement, measurements.stage_steps
        return with_stage_noise(how, recorded.theta, solved, steps)


def said_by(mapped: Mapped, suspect: float) -> Said:
    """Believe a map by as much less as its worst projection fits worse, from `suspect` on.

    What the model cannot explain there pulls all angles, in every row alike.
    """
    said = Said(
        geometry=mapped.geometry,
        quadratic=mapped.quadratic,
        halves=mapped.row_pulls[::2].sum(axis=0) - mapped.row_pulls[1::2].sum(axis=0),
        biases=mapped.bias_pulls,
    )
    return said.weaker(mapped.excess) if mapped.excess > suspect else said


def counted(tracks: Tracks) -> dict[str, int]:
    """Numbers for the report."""
    return {
        "keypoints": int(tracks.keypoints.sum()),
        "fixed to the detector": tracks.fixed_to_detector,
        "features": tracks.n_features,
        "sightings": tracks.n_sightings,
    }


def drawn(placed: Placed) -> dict[str, Floats]:
    """Return what the report draws histograms of, see `Refinement`."""
    _, lengths = np.unique(placed.tracks.feature, return_counts=True)
    return {
        "track_lengths": lengths.astype(np.float64),
        "sighting_residuals": placed.adjusted.residuals,
    }
