"""Long scans: key projections are solved for together, the others placed in the map they make.

Features and map tie every angle to every other, so that time and memory grow with the square of
their number, and the map hardly gets better: it is known to the last detail when projections are
half as many again as columns. So, as others do for videos (keyframes: Klein and Murray, ISMAR
2007), some projections spread over the scan make the map. Each of the others is then compared with
it as it stands, and solved for together with the encoder, between key projections that no longer
move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.products import AngleMeasurements, Quadratic
from tomoslam_stage.progress import progress
from tomoslam_stage.refinement import Fused, Said, fused, lapses, solver_with, with_stage_noise
from tomoslam_stage.scans import only

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from tomoslam_stage.mapping import Look, Made, Placing
    from tomoslam_stage.products import Floats, Geometry, Integers, Scan, StageNoise, Tracks
    from tomoslam_stage.refinement import FactorGraph
    from tomoslam_stage.stages.sources import Outcome

WINDOW = 300
"""Projections that are placed at a time, about: so many angles share a matrix."""
STEPS = 8
"""At most so many for a place in the map."""
SETTLED_DEG = 1e-3
"""Largest change of an angle that counts as none."""
LONGEST = np.deg2rad(1.0)
"""Radians that an angle may change in one step."""
HELD = np.deg2rad(1e-4), 1e-3
"""Radians and px: how firmly angles and shifts of key projections are held."""


@dataclass(frozen=True)
class Window:
    """Projections from one key projection to another."""

    projections: Integers
    """(w,) their numbers, one after the other."""
    recorded: Geometry
    """The recorded angles, turned together so that the first is right."""
    found: Geometry
    """What was found at key projections, in between interpolated."""
    either: tuple[Floats, Floats]
    """(w,) radians each: the angles, were the recorded ones as wrong as at the key projection
    before, and as at the one after."""
    keys: NDArray[np.bool_]
    """(w,) which are key projections."""

    def held(self, quadratic: Quadratic, geometry: Geometry) -> Quadratic:
        """Return what was said at `geometry`, key projections held where they were found."""
        information, pull = quadratic.information.copy(), quadratic.pull.copy()
        away = self.found.since(geometry)
        for entries, sigma in zip(geometry.layout.own, HELD, strict=False):
            held = entries.start + np.flatnonzero(self.keys)
            information[held], information[:, held] = 0, 0
            information[held, held] = sigma**-2
            pull[held] = away[held] / sigma**2
        return Quadratic(information, pull)

    def of_others(self, entries: Floats) -> Floats:
        """(k,) the entries of projections that are none of the key projections."""
        kept = entries.copy()
        for own in self.recorded.layout.own:
            kept[own][self.keys] = 0
        return kept


@dataclass(frozen=True)
class Keyframes:
    """Which projections were solved for, and how the others find their places."""

    scan: Scan
    """All projections, as they are worked on."""
    recorded: Geometry
    """The recorded angles."""
    keys: Integers
    """(m,) numbers of the key projections, the first and the last among them."""
    graph: FactorGraph
    """What the pipeline asks for."""

    def completed(self, outcome: Outcome) -> Outcome:
        """Return what is known about all projections, from what is about the key projections."""
        tracks = None if outcome.tracks is None else self._numbered(outcome.tracks)
        outcome = replace(outcome, tracks=tracks)
        if outcome.fused is None:
            return outcome
        whole, noise = self._placed(outcome.fused, outcome.made, outcome.noise)
        correction, steps = whole.geometry.theta - self.recorded.theta, self.scan.stage_steps
        return replace(
            outcome,
            fused=whole,
            noise=noise,
            events=lapses(self.recorded.theta, correction, whole.step_variances, steps),
            counts={**outcome.counts, "key projections": len(self.keys)},
        )

    def _placed(
        self, known: Fused, made: Made | None, noise: StageNoise | None
    ) -> tuple[Fused, StageNoise | None]:
        """Place all others; without a map where the encoder takes them."""
        windows = self._windows(known)
        if made is None:
            said = [self._unsaid(window) for window in windows]
            graph = self.graph if noise is None else self.graph.informed(noise)
            return self._together(known, windows, said, graph), noise
        placing = made.at(known.geometry)
        variances = np.maximum(*self._beside(made.variances))
        said = [
            self._said(window, placing, variances[window.projections])
            for window in progress(windows, "placing", len(windows))
        ]

        def solved(graph: FactorGraph) -> Fused:
            return self._together(known, windows, said, graph)

        return with_stage_noise(self.graph, self.recorded.theta, solved, self.scan.stage_steps)

    def _windows(self, known: Fused) -> Sequence[Window]:
        """Cut the scan at key projections."""
        here = known.geometry
        unknowns = tuple(name for name in here.unknowns if name not in {"axis", "roll"})
        theta, wrong = self.recorded.theta, here.theta - self.recorded.theta[self.keys]
        correction, either = self._between(wrong), self._beside(wrong)
        found = replace(
            here, theta=theta + correction, shift=self._between(here.shift), unknowns=unknowns
        )
        count = max(1, round(len(theta) / WINDOW))
        ends = np.unique(np.linspace(0, len(self.keys) - 1, count + 1).round().astype(np.intp))
        windows = []
        for first, last in pairwise(self.keys[ends]):
            some = np.arange(first, last + 1)
            part = replace(found, theta=found.theta[some], shift=found.shift[some])
            recorded = replace(part, theta=theta[some] + correction[first], shift=np.empty(0))
            before, after = (theta[some] + each[some] for each in either)
            keys = np.isin(some, self.keys)
            windows.append(Window(some, recorded, part, (before, after), keys))
        return windows

    def _measurements(self, window: Window) -> AngleMeasurements:
        """Return how many steps the stage made between the projections of a window."""
        steps = self.scan.stage_steps[window.projections[:-1]]
        return replace(AngleMeasurements.none(), stage_steps=steps)

    @staticmethod
    def _unsaid(window: Window) -> Said:
        """Hold the key projections, and say nothing about the others."""
        size = window.found.layout.size
        nothing = Quadratic(np.zeros((size, size)), np.zeros(size))
        quadratic = window.held(nothing, window.found)
        return Said(window.found, quadratic, np.zeros(size), np.zeros((0, size)))

    def _said(self, window: Window, placing: Placing, variances: Floats) -> Said:
        """Find the places of projections whose pull has `variances` (w,), see `Made`."""
        solve = solver_with(self.graph, window.recorded, self._measurements(window))
        look = placing.looking(only(self.scan, window.projections))
        geometry = self._begun(window, look)
        for _ in range(STEPS):
            told = placing.told(look(geometry), geometry, variances)
            change = solve(geometry, window.held(told.quadratic, geometry))
            if not np.isfinite(change).all():
                return self._unsaid(window)
            angles = geometry.layout.angles
            change[angles] = np.clip(change[angles], -LONGEST, LONGEST)
            geometry = geometry.moved(change)
            if np.abs(change[angles]).max() < np.deg2rad(SETTLED_DEG):
                break
        told = placing.told(look(geometry), geometry, variances)
        return Said(
            geometry,
            window.held(told.quadratic, geometry),
            window.of_others(told.halves),
            np.zeros((0, geometry.layout.size)),
        )

    @staticmethod
    def _begun(window: Window, look: Callable[[Geometry], Look]) -> Geometry:
        """Return where to begin: each with what the key projections beside it say is wrong.

        A step that was lost between them is seen by the one or by the other, never halfway.
        """
        guesses = [replace(window.found, theta=theta) for theta in window.either]
        before, after = (look(guess).squares.mean(axis=0) for guess in guesses)
        return replace(window.found, theta=np.where(after < before, *window.either[::-1]))

    def _together(
        self, known: Fused, windows: Sequence[Window], said: Sequence[Said], graph: FactorGraph
    ) -> Fused:
        """Solve all windows, and join them: what is between key projections is unsure with them."""
        parts = [
            fused(graph, window.recorded, self._measurements(window), [each])
            for window, each in zip(windows, said, strict=True)
        ]
        steps = np.searchsorted(self.keys, np.arange(1, len(self.recorded.theta))) - 1
        turned = [  # nobody sees a turn of all angles: the solutions are free to differ by one
            part.geometry.theta + np.mean((window.found.theta - part.geometry.theta)[window.keys])
            for window, part in zip(windows, parts, strict=True)
        ]
        shift_sigma = known.shift_sigma
        if shift_sigma is not None:
            own = joined([part.shift_sigma for part in parts if part.shift_sigma is not None])
            shift_sigma = np.hypot(self._between(shift_sigma), own)
        halves = [self._between(half) for half in known.halves]
        placed = joined([part.halves[0] for part in parts])
        return Fused(
            geometry=replace(
                known.geometry,
                theta=joined(turned),
                shift=joined([part.geometry.shift for part in parts]),
            ),
            variances=self._between(known.variances) + joined([part.variances for part in parts]),
            step_variances=known.step_variances[steps]
            + np.concatenate([part.step_variances for part in parts]),
            halves=np.stack([*halves, placed]),
            bias=self._between(known.bias),
            residuals={
                **known.residuals,
                "encoder": np.concatenate([part.residuals["encoder"] for part in parts]),
            },
            shift_sigma=shift_sigma,
        )

    def _beside(self, values: Floats) -> tuple[Floats, Floats]:
        """(n,) each: what the key projection before each projection has, and the one after."""
        every = np.arange(len(self.recorded.theta))
        before = np.searchsorted(self.keys, every, side="right") - 1
        return values[before], values[np.searchsorted(self.keys, every)]

    def _between(self, values: Floats) -> Floats:
        """(n,) what key projections have (m,), interpolated."""
        return np.asarray(np.interp(np.arange(len(self.recorded.theta)), self.keys, values))

    def _numbered(self, tracks: Tracks) -> Tracks:
        """Return the tracks in numbers of all projections."""
        keypoints = np.zeros(len(self.recorded.theta), tracks.keypoints.dtype)
        keypoints[self.keys] = tracks.keypoints
        return replace(tracks, projection=self.keys[tracks.projection], keypoints=keypoints)


def joined(parts: Sequence[Floats]) -> Floats:
    """(n,) the values of windows (w,), of which each begins with the last one of the one before."""
    return np.concatenate([*(part[:-1] for part in parts[:-1]), parts[-1]])
