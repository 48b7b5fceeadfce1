"""Features and map, asked one after the other, with stand-ins that say what they are told to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tomoslam_stage.geometry import rms_difference
from tomoslam_stage.heldout import Rows
from tomoslam_stage.products import Features, Floats, Geometry, Quadratic, Tracks
from tomoslam_stage.refinement import FactorGraph, solver_with
from tomoslam_stage.refinement.factors import Encoder
from tomoslam_stage.refinement.landmarks import Adjusted
from tomoslam_stage.stages import sources
from tomoslam_stage.stages.choosing import FEATURES, MAP, RECORDED, USED, Choice
from tomoslam_stage.stages.sources import Outcome, Sources, said_by
from tomoslam_stage.stages.work import Clock

N = 40
ROWS = 32
TRUE = np.deg2rad(4.5 * np.arange(N))
LOST_DEG = 1.0
RECORDED_ANGLES = TRUE + np.deg2rad(LOST_DEG) * (np.arange(N) >= 20)
START = Geometry(RECORDED_ANGLES, axis=20.0, middle=15.5)
SCAN = SimpleNamespace(n_rows=ROWS, n_projections=N, stage_steps=np.ones(N - 1))
USABLE = np.arange(ROWS) % 8 != 3
MADE = SimpleNamespace()
SIGMA_DEG = 0.03


def quadratic(sigma_deg: float = SIGMA_DEG) -> Quadratic:
    """Say that all is as it should be, each angle but for `sigma_deg`."""
    sigmas = np.append(np.full(N, np.deg2rad(sigma_deg)), [0.05, 0.001])
    return Quadratic(np.diag(sigmas**-2.0), np.zeros(N + 2))


def geometry(error_deg: float = 0.0, seed: int = 0) -> Geometry:
    """Where a source ends that errs by so much, rms."""
    error = np.random.default_rng(seed).normal(0, np.deg2rad(error_deg), N)
    return Geometry(TRUE + error, 20.1, middle=15.5)


def tracks(features: int) -> Tracks:
    """Sight so many features in all projections, each on a row of its own."""
    feature, projection = np.repeat(np.arange(features), N), np.tile(np.arange(N), features)
    row = (feature + 0.5) * ROWS / max(features, 1)
    return Tracks(feature, projection, np.full(len(row), 20.0), row, np.full(N, features))


@dataclass
class Seeing:
    """Stands in for tracking."""

    features: int
    growing: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(fewest=8))

    def see(self, scan: Any, axis: float, usable: Any) -> SimpleNamespace:
        assert scan is SCAN
        assert axis == START.axis
        assert usable is USABLE
        return SimpleNamespace(tracks=tracks(self.features), table=None)


@dataclass
class Placing:
    """Stands in for landmarks: all features, then either half of them, end where they are told."""

    ends: Sequence[Geometry]
    asked: list[Geometry] = field(default_factory=list)

    def adjust(self, seen: Tracks, start: Geometry, solve: Any) -> Adjusted:  # noqa: ARG002
        end = self.ends[len(self.asked)]
        self.asked.append(start)
        nowhere = np.empty(0)
        features = Features(np.empty((0, 2)), np.empty((0, 2, 2)), nowhere, nowhere, 0.1)
        residuals = np.zeros(seen.n_sightings)
        return Adjusted(end, quadratic, features, residuals, residuals + 1, 0.1, 1.0)


@dataclass
class Mapping:
    """Stands in for the map."""

    end: Geometry | None
    excess: float = 1.2
    row_pulls: Floats = field(default_factory=lambda: np.zeros((6, N + 2)))
    bias_pulls: Floats = field(default_factory=lambda: np.zeros((1, N + 2)))
    asked: list[Geometry] = field(default_factory=list)

    def refine(self, scan: Any, rows: Any, start: Geometry, solve: Any) -> SimpleNamespace | None:
        assert scan is SCAN
        np.testing.assert_array_equal(rows, np.flatnonzero(USABLE))
        self.asked.append(start)
        assert np.isfinite(solve(start, quadratic())).all()
        if self.end is None:
            return None
        return SimpleNamespace(
            geometry=self.end,
            quadratic=quadratic(),
            row_pulls=self.row_pulls,
            bias_pulls=self.bias_pulls,
            excess=self.excess,
            made=MADE,
        )


def judge(name: str, found: Geometry) -> Floats:
    """(r, n) residuals that grow with the error of the angles."""
    error = np.rad2deg(rms_difference(found.theta, TRUE))
    noise = np.random.default_rng(len(name)).uniform(0.9, 1.1, (5, N))
    return np.asarray((0.1 + error) * noise)


def asked(
    placing: Placing | None = None, mapping: Mapping | None = None, features: int = 40
) -> Outcome:
    rows = Rows(np.array([3, 11, 19, 27]), USABLE)
    return sources_of(placing, mapping, features).ask(SCAN, rows, START, judge, Clock({}))


def sources_of(
    placing: Placing | None = None, mapping: Mapping | None = None, features: int = 40
) -> Sources:
    how = SimpleNamespace(
        tracks=Seeing(features),
        angles=None,
        closures=None,
        landmarks=placing,
        mapping=mapping,
        closer=None,
        choice=Choice(),
        refinement=FactorGraph(),
        rounds=1,
        settled_deg=0.01,
    )
    return Sources(how)


def error_deg(outcome: Outcome) -> float:
    assert outcome.fused is not None
    return float(np.rad2deg(rms_difference(outcome.fused.geometry.theta, TRUE)))


def placing(error_deg: float = 0.0, halves_deg: float = 0.0) -> Placing:
    """End with this error, and both halves this far (rms) from where all features do."""
    end = geometry(error_deg, seed=1)
    apart = np.append(np.random.default_rng(2).normal(0, np.deg2rad(halves_deg), N), [0, 0])
    return Placing([end, end.moved(apart), end.moved(-apart)])


def test_sources_that_agree_find_the_lost_step_together() -> None:
    outcome = asked(placing(0.02), Mapping(geometry(0.02, seed=3)))
    assert outcome.sources == {FEATURES: USED, MAP: USED}
    assert error_deg(outcome) < 0.025
    (event,) = outcome.events
    assert (event.projection, event.kind) == (20, "lost step")
    assert event.size_deg == pytest.approx(-LOST_DEG, abs=0.1)
    assert outcome.noise is not None
    assert np.rad2deg(outcome.noise.step) < 0.1


def test_what_was_seen_and_used_is_counted() -> None:
    outcome = asked(placing(), Mapping(geometry()))
    assert outcome.counts["features"] == 40
    assert outcome.counts["sightings"] == 40 * N
    assert outcome.counts["keypoints"] == 40 * N
    assert outcome.counts["map rows"] == 6


def test_nothing_is_fused_where_no_source_says_anything() -> None:
    outcome = asked(Placing([]), Mapping(None), features=7)
    assert outcome.fused is None
    assert outcome.sources == {
        FEATURES: "left out: 7 features could be followed; 10 are needed",
        MAP: "left out: 28 rows of 40 projections say nothing about the angles",
    }
    assert outcome.counts["features"] == 7
    assert not outcome.events
    assert outcome.noise is None


def test_either_source_does_without_the_other() -> None:
    only_map = asked(Placing([]), Mapping(geometry(0.02)), features=0)
    only_features = asked(placing(0.02), Mapping(None))
    assert only_map.sources[MAP] == only_features.sources[FEATURES] == USED
    assert only_map.sources[FEATURES].startswith("left out: 0 features")
    assert only_features.sources[MAP].startswith("left out: 28 rows")
    assert max(error_deg(only_map), error_deg(only_features)) < 0.05


def test_sources_that_nobody_asks_are_not_spoken_of() -> None:
    assert asked(mapping=Mapping(geometry())).sources == {MAP: USED}
    assert asked(placing()).sources == {FEATURES: USED}


def test_features_of_which_a_half_is_too_small_are_left_out() -> None:
    # Half of so few features would say hardly anything, and so contradict nothing.
    outcome = asked(placing(), Mapping(geometry()), features=12)
    assert outcome.sources[FEATURES].startswith("left out: half of the features are ")
    assert outcome.sources[MAP] == USED


@pytest.mark.parametrize(("error", "begins_there"), [(0.05, True), (0.9, False)])
def test_the_map_begins_where_unused_rows_reproject_best(error: float, begins_there: bool) -> None:
    mapping, features = Mapping(geometry()), placing(error)
    asked(features, mapping)
    (begun,), ended = mapping.asked, features.ends[0].theta
    assert features.asked[0] is START
    assert (begun is START) != begins_there
    assert (rms_difference(begun.theta, ended) < np.deg2rad(0.02)) == begins_there


@pytest.mark.parametrize(("error", "known"), [(0.08, True), (0.9, False)])
def test_the_map_is_asked_with_the_stage_as_good_features_show_it(
    error: float, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    graphs: list[FactorGraph] = []

    def listening(graph: FactorGraph, *others: Any) -> Any:
        graphs.append(graph)
        return solver_with(graph, *others)

    monkeypatch.setattr(sources, "solver_with", listening)
    asked(placing(error), Mapping(geometry()))
    of_features, of_map = (graph.factors["encoder"] for graph in graphs)
    assert isinstance(of_map, Encoder)
    assert of_features == Encoder()
    if known:
        # Halves agree, so that the stage is blamed for what the features err.
        assert of_map.jitter_deg == pytest.approx(error, rel=0.3)
    else:
        assert of_map == Encoder()


def test_halves_of_the_features_begin_where_all_of_them_ended() -> None:
    features = placing(0.02)
    asked(features)
    assert features.asked[1:] == [features.ends[0]] * 2


def test_a_map_that_does_not_hold_is_left_out_but_told_of() -> None:
    outcome = asked(placing(0.02), Mapping(geometry(0.3, seed=4), excess=4.0))
    assert outcome.sources[FEATURES] == USED
    assert "4.0 times worse" in outcome.sources[MAP]
    assert error_deg(outcome) < 0.05


def test_halves_of_the_features_show_how_sure_the_angles_are() -> None:
    sure, unsure = asked(placing()).fused, asked(placing(halves_deg=0.3)).fused
    assert sure is not None
    assert unsure is not None
    assert np.rad2deg(sure.half_error) < 0.01
    assert np.median(unsure.sigma) > 3 * np.median(sure.sigma)


def test_rows_of_the_map_that_contradict_each_other_show_how_sure_the_angles_are() -> None:
    pull = quadratic().information @ np.append(np.random.default_rng(5).normal(0, 0.003, N), [0, 0])
    contradicting = np.zeros((6, N + 2))
    contradicting[:2] = pull, -pull
    sure = asked(mapping=Mapping(geometry())).fused
    rows = asked(mapping=Mapping(geometry(), row_pulls=contradicting)).fused
    prior = asked(mapping=Mapping(geometry(), bias_pulls=2 * pull[None])).fused
    assert np.median(rows.sigma) > 3 * np.median(sure.sigma)
    assert np.median(prior.sigma) > 3 * np.median(sure.sigma)


def test_a_map_is_believed_less_where_some_projections_do_not_fit() -> None:
    said = [
        said_by(
            Mapping(geometry(), excess).refine(
                SCAN, np.flatnonzero(USABLE), START, lambda *_: np.zeros(N + 2)
            ),
            2.0,
        )
        for excess in (1.9, 2.5)
    ]
    np.testing.assert_allclose(said[0].quadratic.information, quadratic().information)
    np.testing.assert_allclose(said[1].quadratic.information, quadratic().information / 2.5)
    np.testing.assert_allclose(said[1].quadratic.pull, quadratic().pull / 2.5)


def test_recorded_angles_are_judged_first_and_each_source_once() -> None:
    heard: list[str] = []
    both = sources_of(placing(), Mapping(geometry()))

    def listening(name: str, found: Geometry) -> Floats:
        heard.append(name)
        return judge(name, found)

    both.ask(SCAN, Rows(np.array([3]), USABLE), START, listening, Clock({}))
    assert heard == [RECORDED, FEATURES, MAP]
