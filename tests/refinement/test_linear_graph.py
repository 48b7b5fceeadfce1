"""The graph that gtsam solves is the least squares problem of the paper's equations 5 and 6."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest

from tomoslam_stage.geometry import rms
from tomoslam_stage.products import AngleMeasurements, Closures
from tomoslam_stage.refinement.factors import FACTORS, Block, Closure, Cv, Encoder, Prior
from tomoslam_stage.refinement.graph import linear_graph, marginal_sigma, solve_once

N = 14


def random_problem(seed: int) -> tuple[dict[str, Block], dict[str, np.ndarray], np.ndarray]:
    """Blocks of all kinds, with correlated errors; weights; angles to start from."""
    rng = np.random.default_rng(seed)
    theta = np.cumsum(rng.uniform(0.05, 0.2, N))
    triplets = np.array([rng.choice(N, 3, replace=False) for _ in range(9)])
    root = rng.normal(0, 0.01, (9, 2, 2))
    found = AngleMeasurements(
        projections=triplets,
        steps=np.diff(theta[triplets]) + rng.normal(0, 0.02, (9, 2)),
        covariance=root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(2),
        tracks=np.full(9, 30),
        inliers=np.full(9, 20),
        closures=Closures(
            projections=np.array([rng.choice(N, 3, replace=False) for _ in range(6)]),
            share=rng.uniform(0, 0.5, 6),
            turn=rng.normal(0, 1, 6),
            sigma=rng.uniform(0.01, 0.1, 6),
        ),
    )
    recorded = theta + rng.normal(0, 0.01, N)
    factors = Prior(sigma_deg=0.3), Encoder(sigma_deg=0.5), Cv(floor_deg=0.02), Closure()
    blocks = dict(zip(FACTORS, (f.block(recorded, found) for f in factors), strict=True))
    weights = {name: rng.uniform(0.2, 1, len(block.measured)) for name, block in blocks.items()}
    return blocks, weights, recorded + rng.normal(0, 0.05, N)


def dense(
    blocks: dict[str, Block], weights: dict[str, np.ndarray], theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A (d, n) and b (d,) of ``|| A delta - b ||^2``, factor by factor."""
    rows, right = [], []
    for name, block in blocks.items():
        jacobians = np.broadcast_to(
            block.jacobian, (len(block.measured), *block.jacobian.shape[-2:])
        )
        for keys, jacobian, goal, whitening, weight in zip(
            block.projections,
            jacobians,
            block.measured,
            block.whitening,
            weights[name],
            strict=True,
        ):
            full = np.zeros((len(goal), len(theta)))
            full[:, keys] = jacobian
            rows.append(np.sqrt(weight) * whitening @ full)
            right.append(np.sqrt(weight) * whitening @ (goal - full @ theta))
    return np.concatenate(rows), np.concatenate(right)


@pytest.mark.parametrize("seed", range(4))
def test_solution_is_that_of_dense_least_squares(seed: int) -> None:
    blocks, weights, theta = random_problem(seed)
    a, b = dense(blocks, weights, theta)
    expected = np.linalg.lstsq(a, b, rcond=None)[0]
    assert np.abs(expected).max() > 1e-2
    found = solve_once(linear_graph(blocks, weights, theta), N)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_sigma_is_that_of_the_dense_inverse(seed: int) -> None:
    blocks, weights, theta = random_problem(seed)
    a, _ = dense(blocks, weights, theta)
    expected = np.sqrt(np.diag(np.linalg.inv(a.T @ a)))
    found = marginal_sigma(linear_graph(blocks, weights, theta), N)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("correlated", [True, False])
def test_cv_factors_whiten_what_was_measured_and_the_floor(correlated: bool) -> None:
    root = np.random.default_rng(0).normal(0, 0.01, (9, 2, 2))
    covariance = root @ root.transpose(0, 2, 1)
    none = np.zeros(9, int)
    found = AngleMeasurements(np.zeros((9, 3), int), np.zeros((9, 2)), covariance, none, none)
    block = Cv(correlated=correlated, floor_deg=0.2).block(np.zeros(3), found)
    whole = np.linalg.inv(block.whitening.transpose(0, 2, 1) @ block.whitening)
    floor = np.deg2rad(0.2) ** 2 * np.eye(2)
    expected = covariance if correlated else covariance * np.eye(2)
    np.testing.assert_allclose(whole, expected + floor, rtol=1e-9, atol=1e-15)


def test_360_angles_are_built_and_solved_in_an_instant(measured) -> None:
    theta = np.deg2rad(np.arange(360.0))
    parts = [measured(theta, apart) for apart in (4, 5, 10)]
    found = AngleMeasurements(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("projections", "steps", "covariance", "tracks", "inliers")
        )
    )
    blocks = {name: factor().block(theta, found) for name, factor in FACTORS.items()}
    weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
    begin = perf_counter()
    change = solve_once(linear_graph(blocks, weights, theta), 360)
    seconds = perf_counter() - begin
    print(f"360 angles, {len(found.projections)} triplets: {1e3 * seconds:.1f} ms")
    assert np.isfinite(change).all()
    assert seconds < 1


def error_ratio(recorded_errors: np.ndarray, cv_deg: float) -> float:
    """Equation 7 as the ratio of the mean errors; overlapping CV-factors 10 places apart."""
    rng = np.random.default_rng(23)
    n = recorded_errors.shape[1]
    true = np.deg2rad(np.arange(n, dtype=float))
    pairs = np.stack([np.arange(n - 10), np.arange(n - 10) + 10], axis=1)
    sums = np.zeros(2)
    for error in recorded_errors:
        recorded = true + np.deg2rad(error)
        seen = np.deg2rad(10 + rng.normal(0, cv_deg, (len(pairs), 1)))
        whitening = np.full((len(pairs), 1, 1), 1 / np.deg2rad(cv_deg))
        blocks = {
            "prior": Prior().block(recorded, AngleMeasurements.none()),
            "encoder": Encoder(sigma_deg=0.05).block(recorded, AngleMeasurements.none()),
            "cv": Block(pairs, np.array([[-1.0, 1.0]]), seen, whitening),
        }
        weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
        refined = recorded + solve_once(linear_graph(blocks, weights, recorded), n)
        sums += [rms(recorded - true), rms(refined - true)]
    return float(sums[0] / sums[1])


def test_error_ratio_is_the_papers_for_an_encoder_that_walks() -> None:
    steps = np.random.default_rng(1).normal(0, 0.05, (80, 360))
    steps[:, 0] = 0
    assert 2.6 < error_ratio(np.cumsum(steps, axis=1), 0.16) < 3.5
    assert error_ratio(np.cumsum(steps, axis=1), 0.05) > 5


def test_error_ratio_tells_that_a_walk_is_the_wrong_model_of_independent_errors() -> None:
    errors = np.random.default_rng(1).normal(0, 0.05, (60, 360))
    errors[:, 0] = 0
    assert error_ratio(errors, 0.16) < 0.6
