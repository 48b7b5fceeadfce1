"""The graph of all angles, axis and roll, against the dense normal equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.products import (
    STILL,
    UNKNOWNS,
    AngleMeasurements,
    Floats,
    Geometry,
    Layout,
    Quadratic,
    Unknown,
)
from tomoslam_stage.refinement import FactorGraph
from tomoslam_stage.refinement.factors import Cv, Encoder, Prior
from tomoslam_stage.refinement.graph import linear_graph
from tomoslam_stage.refinement.joint import (
    AXIS_SIGMA_PX,
    ROLL_SIGMA_DEG,
    Joint,
)

N = 12
NONE = AngleMeasurements.none()
ENCODER = Encoder(sigma_deg=0.2, jitter_deg=0.1)
PRIOR = Prior(sigma_deg=0.05)


def quadratic(seed: int, rank: int = 2 * N) -> Quadratic:
    """Say something about everything, that no other seed says."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(0, 300, (rank, N + 2))
    return Quadratic(rows.T @ rows, rows.T @ rng.normal(0, 1, rank))


@pytest.fixture
def recorded() -> Geometry:
    steps = np.random.default_rng(1).normal(5, 0.3, N)
    return Geometry(np.deg2rad(np.cumsum(steps)), axis=31.0, middle=12.0)


@pytest.fixture
def here(recorded: Geometry) -> Geometry:
    """Not where the recorded angles are."""
    change = np.deg2rad(np.random.default_rng(2).normal(0, 0.2, N + 2))
    change[-2] = 0.3
    return recorded.moved(change)


@pytest.fixture
def graph() -> FactorGraph:
    """Believe every step, however far it is off."""
    trusting = Encoder(sigma_deg=0.2, jitter_deg=0.1, robust=1e9)
    return FactorGraph(factors={"prior": PRIOR, "encoder": trusting, "cv": Cv()})


def heard_of(said: Quadratic, layout: Layout) -> Joint:
    """Return what is heard of one source alone."""
    joint = Joint.of(layout)
    joint.hear(said)
    return joint


def steps_covariance() -> Floats:
    """(n - 1, n - 1) radians squared: of steps whose ends jitter."""
    steps = np.diff(np.eye(N), axis=0)
    return np.deg2rad(0.2) ** 2 * np.eye(N - 1) + np.deg2rad(0.1) ** 2 * steps @ steps.T


def expected(recorded: Geometry, here: Geometry, said: list[Quadratic]) -> tuple[Floats, Floats]:
    """Information and pull of encoder, prior, axis, roll and sources, written out."""
    free = np.eye(N) - 1 / N
    outwards = np.zeros((N + 2, N + 2))
    outwards[:N, :N], outwards[N:, N:] = free, np.eye(2)
    whitener = np.linalg.inv(np.linalg.cholesky(steps_covariance()))
    steps = whitener @ np.diff(np.eye(N, N + 2), axis=0)
    first = np.eye(1, N + 2) / np.deg2rad(0.05)
    loose = np.eye(N + 2)[N:] / np.array([[AXIS_SIGMA_PX], [np.deg2rad(ROLL_SIGMA_DEG)]])
    rows = np.concatenate([steps, first, loose])
    wanted = rows @ recorded.since(here)
    information = rows.T @ rows + sum(outwards @ q.information @ outwards for q in said)
    return information, rows.T @ wanted + sum(outwards @ q.pull for q in said)


@pytest.mark.parametrize("sources", [0, 1, 2])
def test_joint_graph_solves_the_normal_equations(
    graph: FactorGraph, recorded: Geometry, here: Geometry, sources: int
) -> None:
    said = [quadratic(seed) for seed in range(sources)]
    joint = graph.joint(recorded, NONE, here, said)
    information, pull = expected(recorded, here, said)
    change, covariance = np.linalg.solve(information, pull), np.linalg.inv(information)
    np.testing.assert_allclose(joint.change, change, rtol=1e-6)
    np.testing.assert_allclose(joint.covariance(), covariance, atol=1e-9 * covariance.max())


def test_shifts_are_held_by_how_much_the_sample_jitters(
    graph: FactorGraph, recorded: Geometry, here: Geometry
) -> None:
    shift = np.random.default_rng(8).normal(0, 0.5, N)
    recorded = replace(recorded, unknowns=UNKNOWNS)
    here = replace(here, unknowns=UNKNOWNS, shift=shift)
    rng = np.random.default_rng(9)
    rows = rng.normal(0, 30, (3 * N, 2 * N + 2))
    said = Quadratic(rows.T @ rows, rows.T @ rng.normal(0, 1, 3 * N))
    still = Quadratic(np.zeros((N + 2, N + 2)), np.zeros(N + 2))
    parts = replace(recorded, unknowns=STILL), replace(here, unknowns=STILL)
    information, pull = np.diag(np.full(2 * N + 2, 0.7**-2)), np.zeros(2 * N + 2)
    information[: N + 2, : N + 2], pull[: N + 2] = expected(*parts, [still])
    pull[N + 2 :] = -shift / 0.7**2
    heard = heard_of(said, here.layout)
    information, pull = information + heard.information, pull + heard.pull
    joint = replace(graph, shift_px=0.7).joint(recorded, NONE, here, [said])
    np.testing.assert_allclose(joint.change, np.linalg.solve(information, pull), rtol=1e-6)
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(joint.covariance(), covariance, atol=1e-9 * covariance.max())


@pytest.mark.parametrize("unknowns", [("theta",), ("theta", "axis"), ("theta", "roll", "shift")])
def test_what_is_held_does_not_change_and_what_is_free_is_solved_without_it(
    graph: FactorGraph, recorded: Geometry, here: Geometry, unknowns: tuple[Unknown, ...]
) -> None:
    recorded, here = (replace(g, unknowns=unknowns) for g in (recorded, here))
    size = here.layout.size
    rows = np.random.default_rng(9).normal(0, 30, (3 * N, size))
    joint = graph.joint(recorded, NONE, here, [Quadratic(rows.T @ rows, rows[0])])
    change, covariance = joint.change, joint.covariance()
    held = np.setdiff1d(np.arange(size), here.layout.free(slice(0, size)))
    assert len(held) == len({"axis", "roll"} - set(unknowns))
    assert not change[held].any()
    assert len(covariance) == size - len(held)
    assert (np.diag(covariance) > 0).all()
    assert (np.delete(change, held) != 0).all()


def test_without_sources_the_graph_leads_back_to_what_was_recorded(
    graph: FactorGraph, recorded: Geometry, here: Geometry
) -> None:
    change = graph.joint(recorded, NONE, here, []).change
    np.testing.assert_allclose(change, recorded.since(here), atol=1e-12)


def test_steps_weigh_what_their_robust_noise_model_gives_them_here(recorded: Geometry) -> None:
    walking = Encoder(sigma_deg=0.2, jitter_deg=0.0, robust=4.0)
    robust = FactorGraph(factors={"prior": PRIOR, "encoder": walking})
    jump = np.zeros(N + 2)
    jump[6:N] = 20 * np.deg2rad(0.2)
    covariance = robust.joint(recorded, NONE, recorded.moved(jump), []).covariance()
    step = np.eye(N + 2)[6] - np.eye(N + 2)[5]
    # A Cauchy weight of 1 / (1 + 25) leaves the step so much less sure.
    expected_variance = np.deg2rad(0.2) ** 2 * 26
    assert step @ covariance @ step == pytest.approx(expected_variance, rel=1e-6)


def test_what_a_source_says_about_a_turn_of_all_angles_is_not_heard() -> None:
    heard = heard_of(quadratic(3), Layout(N))
    together = np.append(np.ones(N), [0, 0])
    size = np.abs(heard.information).max()
    np.testing.assert_allclose(heard.information @ together, 0, atol=1e-9 * size)
    assert heard.pull @ together == pytest.approx(0, abs=1e-9 * np.abs(heard.pull).max())


def test_what_a_source_says_about_all_else_is_heard_in_full() -> None:
    said = quadratic(4)
    heard = heard_of(said, Layout(N))
    change = np.random.default_rng(5).normal(0, 1, N + 2)
    change[:N] -= change[:N].mean()
    assert heard.pull @ change == pytest.approx(said.pull @ change)
    assert change @ heard.information @ change == pytest.approx(change @ said.information @ change)


def test_the_angle_of_the_first_projection_stays_whatever_sources_want(
    graph: FactorGraph, recorded: Geometry
) -> None:
    together = np.append(np.ones(N), [0, 0]) * 1e4
    turning = Quadratic(np.outer(together, together), 0.1 * np.outer(together, together)[0])
    change = graph.joint(recorded, NONE, recorded, [turning]).change
    np.testing.assert_allclose(change[:N], 0, atol=1e-12)


def test_the_factors_of_single_angles_are_heard_as_gtsam_has_them(
    measured: Callable[..., AngleMeasurements],
) -> None:
    long = np.deg2rad(np.arange(0, 90, 3.0))
    found = measured(long, apart=4, sigma_deg=0.3)
    parts = {"prior": PRIOR, "encoder": ENCODER, "cv": Cv()}
    blocks = {name: factor.block(long, found) for name, factor in parts.items()}
    theta = long + np.deg2rad(np.random.default_rng(6).normal(0, 0.5, len(long)))
    weights = {name: block.weights(theta) for name, block in blocks.items()}
    graph = linear_graph(blocks, weights, theta)
    joint = Joint.of(Layout(len(long)))
    joint.hear_graph(graph)
    information, pull = graph.hessian()
    np.testing.assert_allclose(joint.information[:-2, :-2], information, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(joint.pull[:-2], pull, rtol=1e-9, atol=1e-6)
    assert any((w < 0.9).any() for w in weights.values())


def test_a_graph_of_some_angles_says_nothing_about_the_others(recorded: Geometry) -> None:
    there = recorded.theta.copy()
    there[0] += 0.1
    block = {"prior": PRIOR.block(recorded.theta, NONE)}
    joint = Joint.of(Layout(N))
    joint.hear_graph(linear_graph(block, {"prior": np.ones(1)}, there))
    expected_information = np.zeros((N + 2, N + 2))
    expected_information[0, 0] = np.deg2rad(0.05) ** -2
    np.testing.assert_allclose(joint.information, expected_information)
    np.testing.assert_allclose(joint.pull, -0.1 * expected_information[0])


def test_steps_of_a_stage_without_jitter_are_the_factors_of_single_steps(
    recorded: Geometry, here: Geometry
) -> None:
    walking = Encoder(sigma_deg=0.2, jitter_deg=0.0, robust=1e9)
    block = walking.block(recorded.theta, NONE)
    chained, single = Joint.of(here.layout), Joint.of(here.layout)
    chained.hear_chain(*walking.chain(recorded.theta, here.theta, NONE))
    weights = {"encoder": block.weights(here.theta)}
    single.hear_graph(linear_graph({"encoder": block}, weights, here.theta))
    for name in ("information", "pull"):
        one, other = getattr(chained, name), getattr(single, name)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_usual_errors_of_angles_that_jitter_do_not_let_them_drift(recorded: Geometry) -> None:
    encoder = Encoder(sigma_deg=0.002, jitter_deg=0.1)
    errors = np.deg2rad(np.random.default_rng(0).normal(0, 0.1, N))
    usual, _ = encoder.chain(recorded.theta, recorded.theta, NONE)
    found, wanted = encoder.chain(recorded.theta, recorded.theta + errors, NONE)
    np.testing.assert_allclose(found, usual)
    np.testing.assert_allclose(wanted, -np.diff(errors))


def test_only_a_step_that_is_far_off_has_its_variance_raised(recorded: Geometry) -> None:
    encoder = Encoder(sigma_deg=0.1, jitter_deg=0.1, robust=4.0)
    lost = np.deg2rad(2.0) * (np.arange(N) >= 5)
    usual, _ = encoder.chain(recorded.theta, recorded.theta, NONE)
    (found, shared), _ = encoder.chain(recorded.theta, recorded.theta + lost, NONE)
    assert found[4] == pytest.approx(np.deg2rad(2.0 / 4.0) ** 2)
    np.testing.assert_allclose(np.delete(found, 4), np.delete(usual[0], 4))
    np.testing.assert_allclose(shared, usual[1])


@pytest.mark.parametrize("jitter_deg", [0.0, 0.1])
def test_the_encoder_holds_projections_less_with_more_steps_in_between(
    recorded: Geometry, jitter_deg: float
) -> None:
    encoder = Encoder(sigma_deg=0.2, jitter_deg=jitter_deg)
    steps = np.ones(N - 1)
    steps[4] = 9
    known = replace(NONE, stage_steps=steps)
    variances = np.deg2rad(0.2) ** 2 * steps + 2 * np.deg2rad(jitter_deg) ** 2
    whitening = encoder.block(recorded.theta, known).whitening[:, 0, 0]
    np.testing.assert_allclose(whitening**-2, variances)
    covariance, wanted = encoder.chain(recorded.theta, recorded.theta, known)
    np.testing.assert_allclose(covariance[0], variances)
    np.testing.assert_allclose(wanted, 0)
