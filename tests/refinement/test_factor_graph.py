from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.geometry import rms
from tomoslam_stage.methods import checked
from tomoslam_stage.products import AngleMeasurements
from tomoslam_stage.refinement import FACTORS, FactorGraph
from tomoslam_stage.refinement.factors import Block, Cv, Encoder, Prior
from tomoslam_stage.refinement.solve import Solver, typical

TRUE = np.deg2rad(np.arange(0, 180, 2.0))


def walked(sigma_deg: float = 0.05, seed: int = 2) -> np.ndarray:
    """(n,) radians: recorded angles that walk away from `TRUE`."""
    steps = np.random.default_rng(seed).normal(0, np.deg2rad(sigma_deg), len(TRUE))
    steps[0] = 0
    return TRUE + np.cumsum(steps)


def graph(**factors: object) -> FactorGraph:
    return FactorGraph(factors={"prior": Prior(), "encoder": Encoder(), "cv": Cv(), **factors})


def error(theta: np.ndarray) -> float:
    """Degrees, first angle fixed."""
    return float(np.rad2deg(rms(theta - theta[0] - TRUE)))


def test_recorded_angles_stay_where_nothing_was_measured(unmeasured: AngleMeasurements) -> None:
    recorded = walked()
    solution = FactorGraph().solve(recorded, unmeasured)
    np.testing.assert_allclose(solution.theta, recorded, atol=1e-12)
    steps = np.arange(len(TRUE))
    expected = np.hypot(Prior().sigma_deg, 0.05 * np.sqrt(steps))
    np.testing.assert_allclose(np.rad2deg(solution.sigma), expected, rtol=1e-3)


def test_measured_steps_pull_the_angles_to_where_they_were(measured) -> None:
    recorded = walked(0.15)
    solution = graph(encoder=Encoder(sigma_deg=0.15), cv=Cv(floor_deg=0)).solve(
        recorded, measured(TRUE, sigma_deg=0.05)
    )
    assert error(recorded) > 0.3
    assert error(solution.theta) < error(recorded) / 2.5
    assert set(solution.residuals) == {"prior", "encoder", "cv"}
    cv = solution.residuals["cv"]
    assert 0.03 < np.rad2deg(rms(cv)) < 0.06


def test_the_first_angle_stays_where_it_was_recorded(measured) -> None:
    recorded = walked() + 1.3
    solution = FactorGraph().solve(recorded, measured(TRUE))
    assert abs(np.rad2deg(solution.theta[0] - recorded[0])) < 1e-3
    assert np.rad2deg(solution.sigma[0]) == pytest.approx(1e-3, rel=1e-3)
    assert np.abs(np.rad2deg(solution.theta - recorded)).max() > 0.1


def test_sigma_is_the_error_the_angles_have(measured) -> None:
    pulls = []
    for seed in range(12):
        recorded = walked(seed=seed)
        noisy = measured(TRUE, sigma_deg=0.0, said_deg=0.1)
        jitter = np.random.default_rng(seed + 50).normal(0, np.deg2rad(0.1), noisy.steps.shape)
        found = replace(noisy, steps=noisy.steps + jitter)
        solution = graph(cv=Cv(floor_deg=0.0)).solve(recorded, found)
        pulls.append(((solution.theta - TRUE) / solution.sigma)[1:])
    assert 0.8 < np.std(pulls) < 1.3


@pytest.fixture
def lost(measured) -> tuple[np.ndarray, AngleMeasurements]:
    """Recorded angles that miss a lost step of 1.5 degrees, and what the features saw."""
    recorded = TRUE + np.deg2rad(1.5) * (np.arange(len(TRUE)) >= 45)
    return recorded, measured(TRUE, sigma_deg=0.05)


def test_a_lost_step_does_not_smear_over_its_neighbours(lost) -> None:
    recorded, found = lost
    robust = graph().solve(recorded, found)
    gaussian = graph(encoder=Encoder(robust=1e6)).solve(recorded, found)
    near = slice(38, 52)
    off = [np.rad2deg(np.abs(s.theta - TRUE)[near].max()) for s in (robust, gaussian)]
    assert off[0] < 0.15
    assert off[1] > 3 * off[0]
    step = np.rad2deg(np.diff(robust.theta)[44])
    assert step == pytest.approx(2.0, abs=0.1)


def test_wrong_measurements_lose_their_grip(measured) -> None:
    found = measured(TRUE, sigma_deg=0.05)
    steps = found.steps.copy()
    steps[::9] += np.deg2rad(2.0)
    wrong = replace(found, steps=steps)
    robust = graph().solve(TRUE, wrong)
    gaussian = graph(cv=Cv(robust=1e6)).solve(TRUE, wrong)
    assert error(robust.theta) < 0.1
    assert error(gaussian.theta) > 4 * error(robust.theta)


def test_noise_models_that_promise_too_much_are_widened(measured) -> None:
    boasting = measured(TRUE, sigma_deg=0.5, said_deg=0.1)
    parts = {"cv": Cv(floor_deg=0.0), "encoder": Encoder(sigma_deg=0.02)}
    widened = graph(**parts).solve(TRUE, boasting)
    believed = replace(graph(**parts), solver=Solver(rescale=())).solve(TRUE, boasting)
    assert widened.scale["cv"] == pytest.approx(5, rel=0.2)
    assert widened.scale["encoder"] == 1
    assert believed.scale == {"prior": 1, "encoder": 1, "cv": 1}
    assert np.median(widened.sigma / believed.sigma) > 1.2
    assert error(widened.theta) < error(believed.theta)


def test_noise_models_are_never_narrowed(measured) -> None:
    modest = measured(TRUE, sigma_deg=0.05, said_deg=0.5)
    assert graph(cv=Cv(floor_deg=0.0)).solve(walked(), modest).scale["cv"] == pytest.approx(1)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_typical_residual_of_a_right_noise_model_is_one(dimensions: int) -> None:
    measured = np.random.default_rng(0).normal(0, 0.3, (20_000, dimensions))
    block = Block(
        projections=np.zeros((20_000, dimensions), int),
        jacobian=np.zeros((dimensions, dimensions)),
        measured=measured,
        whitening=np.tile(np.eye(dimensions) / 0.3, (20_000, 1, 1)),
    )
    assert typical(block, np.zeros(1)) == pytest.approx(1, rel=0.02)


def test_weights_fall_with_the_distance() -> None:
    block = Block(
        projections=np.zeros((3, 1), int),
        jacobian=np.ones((1, 1)),
        measured=np.array([[0.0], [2.0], [20.0]]),
        whitening=np.ones((3, 1, 1)),
        robust=2.0,
    )
    np.testing.assert_allclose(block.weights(np.zeros(1)), [1, 0.5, 1 / 101])
    assert (replace(block, robust=np.inf).weights(np.zeros(1)) == 1).all()


def test_weighing_goes_on_until_the_angles_settle(lost) -> None:
    recorded, found = lost
    once, settled, longer = (
        replace(graph(), solver=Solver(rounds=rounds)).solve(recorded, found).theta
        for rounds in (1, 30, 60)
    )
    assert error(settled) < error(once) / 2
    assert np.rad2deg(np.abs(settled - longer).max()) < 0.01


def test_factors_take_their_parameters_by_name() -> None:
    spec = {"prior": None, "encoder": {"sigma_deg": 0.2}, "cv": Cv(floor_deg=0.3)}
    chosen = checked(FactorGraph, {"factors": spec}, "refinement")
    assert chosen.factors == {
        "prior": Prior(),
        "encoder": Encoder(sigma_deg=0.2),
        "cv": Cv(floor_deg=0.3),
    }
    assert FactorGraph().factors == {name: factor() for name, factor in FACTORS.items()}


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        (
            {"prior": {}, "encodr": {}},
            r"refinement\.factors: no factor 'encodr'\. Did you mean 'enco",
        ),
        (
            {"prior": {}, "encoder": {}, 7: {}},
            r"no factor 7\. Known: closure, cv, encoder, prior\.",
        ),
        (
            {"prior": {"sigma": 1}, "encoder": {}},
            r"refinement\.factors\.prior: no parameter 'sigma'",
        ),
        (
            {"prior": {}, "encoder": {"sigma_deg": 0.0}},
            r"refinement\.factors\.encoder\.sigma_deg: 0\.0 does not fit",
        ),
        (
            {"encoder": {}, "cv": {}},
            r"^refinement\.factors: the factor 'prior' is missing; without it some angle is held "
            r"by nothing\. Add 'prior: \{\}'\.$",
        ),
        ({"prior": {}, "cv": {}}, r"the factor 'encoder' is missing"),
    ],
)
def test_factors_that_cannot_be_are_refused(factors: dict[object, object], says: str) -> None:
    with pytest.raises(PipelineError, match=says):
        checked(FactorGraph, {"factors": factors}, "refinement")


def test_a_graph_of_recorded_steps_alone_is_solved_without_cv(measured) -> None:
    recorded = walked()
    solution = FactorGraph(factors={"prior": Prior(), "encoder": Encoder()}).solve(
        recorded, measured(TRUE)
    )
    np.testing.assert_allclose(solution.theta, recorded, atol=1e-12)
    assert set(solution.scale) == {"prior", "encoder"}
