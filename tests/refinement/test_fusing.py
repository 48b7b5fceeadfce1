"""Several sources in one graph, and what each is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.geometry import rms, unseen_shifts
from tomoslam_stage.products import AngleMeasurements, Floats, Geometry, Quadratic
from tomoslam_stage.refinement import (
    FactorGraph,
    Fused,
    Said,
    agree,
    as_one,
    fused,
    honest,
    solver_with,
)
from tomoslam_stage.refinement.factors import Cv, Encoder, Prior
from tomoslam_stage.refinement.fusing import uncertain

N = 40
NONE = AngleMeasurements.none()
LOOSE = FactorGraph(factors={"prior": Prior(), "encoder": Encoder(sigma_deg=50.0), "cv": Cv()})
"""An encoder that has hardly any say."""
RECORDED = Geometry(np.deg2rad(4.0 * np.arange(N)), axis=30.0, middle=10.0)
FREE = np.eye(N) - 1 / N
"""Takes the common angle out."""


def off(seed: int, deg: float, axis: float = 0.0) -> Floats:
    """(n + 2,) a change by angles of so many degrees rms, and of the axis by so many px."""
    angles = np.random.default_rng(seed).normal(0, np.deg2rad(deg), N)
    return np.append(angles, [axis, 0.0])


def source(best: Geometry, sigma_deg: float, at: Geometry | None = None, **more: Floats) -> Said:
    """Say that `best` is right, each angle but for `sigma_deg`; told from `at`."""
    at = best if at is None else at
    weights = np.append(np.full(N, np.deg2rad(sigma_deg)), [0.1, np.deg2rad(0.05)]) ** -2
    information = np.diag(weights)
    silent = {"halves": np.zeros(N + 2), "biases": np.zeros((1, N + 2))}
    quadratic = Quadratic(information, information @ best.since(at))
    return Said(geometry=at, quadratic=quadratic, **silent | more)


def together(*said: Said, graph: FactorGraph = LOOSE) -> Fused:
    return fused(graph, RECORDED, NONE, said)


def test_one_source_is_believed_where_the_encoder_has_no_say() -> None:
    best = RECORDED.moved(off(1, 0.5, axis=0.2))
    found = together(source(best, 0.05))
    np.testing.assert_allclose(FREE @ (found.geometry.theta - best.theta), 0, atol=1e-6)
    # Half a pixel of freedom against a tenth: 25 parts of 26.
    assert found.geometry.axis == pytest.approx(30 + 0.2 * 25 / 26)
    np.testing.assert_allclose(np.rad2deg(found.formal), 0.05 * np.sqrt(1 - 1 / N), rtol=1e-4)
    np.testing.assert_array_equal(found.sigma, found.formal)


def test_two_sources_meet_at_their_weighted_mean() -> None:
    first, second = (RECORDED.moved(off(seed, 0.5)) for seed in (1, 2))
    found = together(source(first, 0.1), source(second, 0.2))
    mean = 0.8 * first.theta + 0.2 * second.theta
    np.testing.assert_allclose(FREE @ (found.geometry.theta - mean), 0, atol=1e-6)
    sigma = np.rad2deg(rms(found.sigma))
    assert sigma == pytest.approx((0.1**-2 + 0.2**-2) ** -0.5, rel=0.02)


def test_where_a_source_is_told_from_makes_no_difference() -> None:
    best = RECORDED.moved(off(1, 0.5, axis=0.3)), RECORDED.moved(off(2, 0.5, axis=0.1))
    far = RECORDED.moved(off(3, 2.0, axis=-0.4)), RECORDED.moved(off(4, 2.0, axis=0.6))
    there = together(source(best[0], 0.1), source(best[1], 0.2))
    elsewhere = together(source(best[0], 0.1, far[0]), source(best[1], 0.2, far[1]))
    np.testing.assert_allclose(elsewhere.geometry.theta, there.geometry.theta, atol=1e-9)
    assert elsewhere.geometry.axis == pytest.approx(there.geometry.axis)
    np.testing.assert_allclose(elsewhere.variances, there.variances, atol=1e-12)


def test_the_order_of_sources_makes_no_difference() -> None:
    said = [source(RECORDED.moved(off(s, 0.3)), 0.1 * s, RECORDED.moved(off(9, s))) for s in (1, 2)]
    one, other = together(*said), together(*said[::-1])
    np.testing.assert_allclose(one.geometry.theta, other.geometry.theta, atol=1e-9)


def test_a_lost_step_does_not_smear_where_sources_see_it() -> None:
    true = RECORDED.moved(np.append(np.deg2rad(3.0) * (np.arange(N) >= 20), [0.0, 0.0]))
    tight = {"prior": Prior(), "cv": Cv()}
    robust, gaussian = (
        together(source(true, 0.15), graph=FactorGraph(factors={**tight, "encoder": encoder}))
        for encoder in (Encoder(sigma_deg=0.1), Encoder(sigma_deg=0.1, robust=1e6))
    )
    errors = [rms(FREE @ (f.geometry.theta - true.theta)) for f in (robust, gaussian)]
    assert errors[0] < errors[1] / 3
    step = np.rad2deg(np.diff(robust.geometry.theta)[19])
    assert step == pytest.approx(7.0, abs=0.2)
    assert set(robust.residuals) == {"prior", "encoder", "cv"}
    assert np.rad2deg(robust.residuals["encoder"][19, 0]) == pytest.approx(3.0, abs=0.2)


def test_the_common_angle_makes_no_angle_and_no_step_unsure() -> None:
    rows = np.random.default_rng(0).normal(0, 1, (9, N))
    covariance, steps = rows.T @ rows, np.diff(np.eye(N), axis=0)
    variances, step_variances = uncertain(covariance + 7.0)
    np.testing.assert_allclose(variances, np.diag(FREE @ covariance @ FREE), atol=1e-9)
    np.testing.assert_allclose(step_variances, np.diag(steps @ covariance @ steps.T), atol=1e-9)


def pulled(deg: float, sigma_deg: float, seed: int = 7) -> Floats:
    """(n + 2,) what pulls a source of `sigma_deg` by so many degrees rms."""
    return off(seed, deg) * np.deg2rad(sigma_deg) ** -2


def test_halves_and_assumptions_tell_how_far_they_move_the_angles() -> None:
    more = {"halves": pulled(0.3, 0.1), "biases": pulled(0.2, 0.1, seed=8)[None]}
    found = together(source(RECORDED, 0.1, **more))
    np.testing.assert_allclose(found.halves[0], FREE @ off(7, 0.3)[:N], rtol=1e-2, atol=1e-5)
    np.testing.assert_allclose(found.bias, np.abs(FREE @ off(8, 0.2)[:N]), rtol=1e-2, atol=1e-5)
    assert found.half_error == pytest.approx(rms(found.halves[0]))
    np.testing.assert_allclose(
        rms(found.sigma), np.hypot(found.half_error, rms(found.bias)), rtol=1e-3
    )


def test_halves_that_agree_better_than_promised_change_no_sigma() -> None:
    found = together(source(RECORDED, 0.1, halves=pulled(0.02, 0.1)))
    np.testing.assert_array_equal(found.sigma, together(source(RECORDED, 0.1)).sigma)


def test_the_halves_of_all_sources_add_up() -> None:
    said = [source(RECORDED, 0.1, halves=pulled(0.3, 0.1, seed=s)) for s in (7, 8)]
    both = together(*said)
    assert both.halves.shape == (2, N)
    assert both.half_error**2 == pytest.approx(sum(rms(h) ** 2 for h in both.halves))


def test_a_source_that_overstates_itself_is_made_less_sure() -> None:
    boasting = source(RECORDED.moved(off(1, 0.4)), 0.1, halves=pulled(0.3, 0.1))
    alone = together(boasting)
    weaker = honest(boasting, alone)
    excess = rms(alone.sigma) / rms(alone.formal)
    assert 2 < excess < 4
    for name in ("information", "pull"):
        once, now = (getattr(said.quadratic, name) for said in (boasting, weaker))
        np.testing.assert_allclose(now, once / excess**2)
    assert weaker.geometry is boasting.geometry
    again = together(weaker)
    np.testing.assert_allclose(again.geometry.theta, alone.geometry.theta, atol=1e-5)
    # Now it promises what it can hold, and is not made weaker a second time.
    assert rms(again.formal) == pytest.approx(rms(alone.sigma), rel=0.01)


def test_halves_that_show_no_more_than_promised_make_no_source_weaker() -> None:
    modest = source(RECORDED, 0.1, halves=pulled(0.05, 0.1))
    weaker = honest(modest, together(modest))
    np.testing.assert_array_equal(weaker.quadratic.information, modest.quadratic.information)
    np.testing.assert_array_equal(weaker.halves, modest.halves)


def test_an_assumption_makes_no_source_weaker_but_the_angles_less_sure() -> None:
    assuming = source(RECORDED.moved(off(1, 0.4)), 0.1, biases=pulled(0.3, 0.1)[None])
    alone = together(assuming)
    same = honest(assuming, alone)
    np.testing.assert_array_equal(same.quadratic.information, assuming.quadratic.information)
    assert rms(together(same).sigma) > 2 * rms(alone.formal)


def test_a_source_made_honest_gives_way_to_one_that_is() -> None:
    wrong = source(RECORDED.moved(off(1, 0.5)), 0.1, halves=pulled(0.6, 0.1))
    right = source(RECORDED.moved(off(2, 0.5)), 0.1)
    found = together(honest(wrong, together(wrong)), honest(right, together(right)))
    away = [rms(FREE @ (found.geometry.theta - s.geometry.theta)) for s in (right, wrong)]
    assert away[0] < away[1] / 10


def test_sources_that_are_misled_alike_are_together_no_surer_than_one() -> None:
    one = source(RECORDED.moved(off(1, 0.5)), 0.1)
    alone, both = together(one), together(one, one)
    assert rms(both.sigma) < 0.8 * rms(alone.sigma)
    np.testing.assert_allclose(together(*as_one([one, one])).sigma, alone.sigma, rtol=0.01)
    assert as_one([one]) == [one]


def test_doubt_of_the_sources_makes_no_angle_less_sure_than_the_stage() -> None:
    one = source(RECORDED.moved(off(1, 0.05)), 1.0)
    held = replace(LOOSE, factors={**LOOSE.factors, "encoder": Encoder(sigma_deg=0.02)})
    usual, doubted = (fused(held, RECORDED, NONE, said) for said in ([one] * 2, as_one([one] * 2)))
    assert rms(usual.sigma) < rms(doubted.sigma) < 1.1 * rms(usual.sigma)


def test_a_source_is_told_what_the_graph_wants() -> None:
    best = RECORDED.moved(off(1, 0.5))
    said = source(best, 0.05, at=RECORDED)
    change = solver_with(LOOSE, RECORDED, NONE)(RECORDED, said.quadratic)
    np.testing.assert_allclose(FREE @ (change[:N] - off(1, 0.5)[:N]), 0, atol=1e-6)


@pytest.mark.parametrize(("apart", "same"), [(0.2, True), (0.4, True), (0.5, False)])
def test_solutions_agree_within_their_joint_sigma(apart: float, same: bool) -> None:
    one, other = together(source(RECORDED, 0.1)), together(source(RECORDED, 0.1))
    pattern = np.where(np.arange(N) % 2, 1.0, -1.0) * np.deg2rad(apart)
    moved = replace(other, geometry=RECORDED.moved(np.append(pattern + 1.0, [0, 0])))
    # Three times 0.1 degrees times the root of two is 0.42 degrees; a common turn is nothing.
    assert agree(one, moved, 3.0) is same
    assert agree(moved, one, 3.0) is same


def test_a_source_that_looked_from_turned_angles_turns_no_angle_against_the_others() -> None:
    root = np.random.default_rng(3).normal(size=(N + 2, N + 2))
    said = Quadratic(1e4 * root @ root.T, np.zeros(N + 2))
    turned = RECORDED.moved(np.append(np.full(N, np.deg2rad(2)), [0.0, 0.0]))
    first, second = (replace(source(at, 0.1), quadratic=said) for at in (RECORDED, turned))
    found = together(first, second)
    np.testing.assert_allclose(FREE @ (found.geometry.theta - RECORDED.theta), 0, atol=1e-6)


def test_shifts_are_unsure_but_for_what_nobody_sees_of_them() -> None:
    unknowns = ("theta", "axis", "roll", "shift")
    start = replace(RECORDED, unknowns=unknowns)
    weights = np.append(source(RECORDED, 0.05).quadratic.information.diagonal(), np.full(N, 1e4))
    information = np.diag(weights)
    pull = np.zeros(2 * N + 2)
    unseen = unseen_shifts(start.theta)
    pull[N + 2 :] = 1e4 * 0.5 * unseen[:, 1]
    said = Said(start, Quadratic(information, pull), np.zeros(2 * N + 2), pull[None])
    found = fused(LOOSE, start, NONE, [said])
    # A hundredth of a px each, of which three of all combinations are no error, nor are those
    # that an assumption adds.
    wanted = 0.01 * np.sqrt(1 - (unseen**2).sum(axis=1))
    np.testing.assert_allclose(found.shift_sigma, wanted, rtol=1e-3)
    np.testing.assert_allclose(found.shift, 0.5 * unseen[:, 1], rtol=1e-3, atol=1e-6)
    assert together(source(RECORDED, 0.05)).shift_sigma is None
    assert together(source(RECORDED, 0.05)).shift is None
