"""Which sources of angles are believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import checked
from tomoslam_stage.products import UNKNOWNS, Floats, Geometry
from tomoslam_stage.refinement import Fused
from tomoslam_stage.stages.choosing import FEATURES, MAP, RECORDED, USED, Choice, falls

N = 48
THETA = np.linspace(0, 2 * np.pi, N, endpoint=False)
SIGMA_DEG = 0.1


def alone(apart_deg: float = 0.0, turned: float = 0.0) -> Fused:
    """Find angles so far (rms) from `THETA`, and as sure as `SIGMA_DEG`."""
    apart = np.where(np.arange(N) % 2, 1, -1) * np.deg2rad(apart_deg)
    return Fused(
        geometry=Geometry(THETA + apart + turned, 30.0),
        variances=np.full(N, np.deg2rad(SIGMA_DEG) ** 2),
        step_variances=np.full(N - 1, 2 * np.deg2rad(SIGMA_DEG) ** 2),
        halves=np.zeros((1, N)),
        bias=np.zeros(N),
        residuals={},
    )


def squares(**levels: float) -> dict[str, Floats]:
    """(r, n) mean squared residuals of these levels, which everywhere scatter by a third."""
    rng = np.random.default_rng(4)
    return {name: level * rng.uniform(0.7, 1.4, (6, N)) for name, level in levels.items()}


AS_GOOD = squares(recorded=1.0, features=0.5, map=0.5)
CLOSE = {FEATURES: alone(), MAP: alone(0.2)}
APART = {FEATURES: alone(), MAP: alone(0.6)}


def test_sources_that_agree_are_both_used() -> None:
    assert Choice().of(CLOSE, 1.5, AS_GOOD, THETA) == {FEATURES: USED, MAP: USED}


def test_a_turn_of_all_angles_is_no_disagreement() -> None:
    found = {FEATURES: alone(), MAP: alone(0.2, turned=0.5)}
    assert Choice().of(found, 1.5, AS_GOOD, THETA) == {FEATURES: USED, MAP: USED}


@pytest.mark.parametrize("name", [FEATURES, MAP])
@pytest.mark.parametrize("excess", [1.0, 3.9])
def test_a_source_that_is_alone_is_used_for_the_gate_to_judge(name: str, excess: float) -> None:
    worse = squares(recorded=1.0) | squares(**{name: 2.0})
    assert Choice().of({name: alone()}, excess, worse, THETA) == {name: USED}


def test_nothing_is_chosen_where_nothing_was_found() -> None:
    assert Choice().of({}, 1.0, squares(recorded=1.0), THETA) == {}


@pytest.mark.parametrize(
    ("lower", "other", "levels"),
    [(FEATURES, MAP, (0.3, 0.8)), (MAP, FEATURES, (0.8, 0.3))],
)
def test_unused_rows_decide_where_sources_disagree(
    lower: str, other: str, levels: tuple[float, float]
) -> None:
    judged = squares(recorded=1.0, features=levels[0], map=levels[1])
    chosen = Choice().of(APART, 1.0, judged, THETA)
    assert chosen[lower] == USED
    assert chosen[other] == ("left out: 0.6 degrees apart, and unused rows speak for the other")


def test_features_need_significance_to_win_over_the_map() -> None:
    assert Choice().of(APART, 1.0, AS_GOOD, THETA)[MAP] == USED
    assert Choice().of(APART, 1.0, AS_GOOD, THETA)[FEATURES] != USED


@pytest.mark.parametrize("found", [CLOSE, APART])
def test_a_map_that_does_not_hold_all_projections_is_left_out(found: dict[str, Fused]) -> None:
    # Unused rows, which the same model reprojects, even speak for the map.
    judged = squares(recorded=1.0, features=0.5, map=0.2)
    assert Choice().of(found, 2.4, judged, THETA) == {
        FEATURES: USED,
        MAP: "left out: some projections fit 2.4 times worse than usual",
    }
    assert Choice().of(found, 2.0, judged, THETA)[MAP] == USED


@pytest.mark.parametrize("found", [CLOSE, {FEATURES: CLOSE[FEATURES]}])
def test_nothing_is_believed_where_some_projections_cannot_be_explained_at_all(
    found: dict[str, Fused],
) -> None:
    why = (
        "left out: some projections fit 22 times worse than usual, "
        "too badly for a sample that stands still in a parallel beam"
    )
    judged = squares(recorded=1.0, features=0.1, map=0.1)
    assert Choice().of(found, 21.8, judged, THETA) == dict.fromkeys(found, why)


def test_such_a_map_stays_where_features_are_no_better_than_what_was_recorded() -> None:
    judged = squares(recorded=1.0, features=1.1, map=0.5)
    assert Choice().of(APART, 3.8, judged, THETA)[MAP] == USED
    assert Choice().of(CLOSE, 3.8, judged, THETA) == {FEATURES: USED, MAP: USED}


@pytest.mark.parametrize("names", [(FEATURES, MAP), (MAP,)])
def test_no_such_map_is_used_where_shifts_may_take_up_what_it_cannot_explain(
    names: tuple[str, ...],
) -> None:
    judged = squares(recorded=1.0, features=1.1, map=0.5)
    jittered = {
        name: replace(f, geometry=replace(f.geometry, unknowns=UNKNOWNS))
        for name, f in CLOSE.items()
        if name in names
    }
    assert Choice().of(jittered, 2.3, judged, THETA)[MAP].startswith("left out: some projections")
    assert Choice().of(jittered, 2.1, judged, THETA) == dict.fromkeys(names, USED)


def test_limits_can_be_chosen() -> None:
    judged = squares(recorded=1.0, features=0.3, map=0.8)
    assert Choice(agreement=5.0).of(APART, 1.0, judged, THETA)[MAP] == USED
    assert Choice(agreement=1.0).of(CLOSE, 1.0, judged, THETA)[MAP] != USED
    assert Choice(most_excess=1.2).of(CLOSE, 1.3, judged, THETA)[MAP] != USED
    assert Choice(most_excess=1.4).of(CLOSE, 1.3, judged, THETA)[MAP] == USED


@pytest.mark.parametrize("wrong", [{"most_excess": 1.0}, {"agreement": 0.0}])
def test_limits_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(PipelineError, match="does not fit"):
        checked(Choice, wrong, "choice")


def test_a_residual_falls_where_it_is_lower_in_most_parts() -> None:
    judged = squares(recorded=1.0, features=0.5, map=0.97)
    assert falls(judged, FEATURES, RECORDED, THETA)
    assert not falls(judged, RECORDED, FEATURES, THETA)
    assert not falls(judged | {MAP: judged[RECORDED][::-1]}, MAP, RECORDED, THETA)
    assert not falls(judged, MAP, MAP, THETA)
