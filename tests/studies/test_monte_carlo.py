"""Errors of many linear graphs at once are those of the graphs, one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.products import AngleMeasurements
from tomoslam_stage.refinement.factors import Block, Encoder, Prior
from tomoslam_stage.refinement.graph import linear_graph, solve_once
from tomoslam_stage.studies.error_ratio import ErrorRatio, reach_said
from tomoslam_stage.studies.monte_carlo import (
    READINGS,
    Graphs,
    Sigmas,
    crossing,
    differences,
    rmse,
)


def solved(graphs: Graphs, sigmas: Sigmas, draw: int) -> np.ndarray:
    """(n,) degrees: errors of the angles that the graph of the pipeline finds for one draw."""
    true = np.linspace(0, 2 * np.pi, graphs.angles, endpoint=False)
    recorded = true + np.deg2rad(sigmas.encoder * graphs.stepper[:, draw])
    here = np.arange(graphs.angles - graphs.away)
    pairs = np.stack([here, here + graphs.away], axis=1)
    noise = np.deg2rad(sigmas.cv * graphs.cv[:, draw, None])
    nothing = AngleMeasurements.none()
    blocks = {
        "prior": Prior().block(recorded, nothing),
        "encoder": Encoder(sigma_deg=sigmas.encoder).block(recorded, nothing),
        "cv": Block(
            projections=pairs,
            jacobian=np.array([[-1.0, 1.0]]),
            measured=np.diff(true[pairs], axis=1) + noise,
            whitening=np.full((len(pairs), 1, 1), 1 / np.deg2rad(sigmas.cv)),
        ),
    }
    weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
    change = solve_once(linear_graph(blocks, weights, recorded), graphs.angles)
    return np.rad2deg(recorded + change - true)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize(("step", "sigmas"), [(4, Sigmas(0.02, 0.1)), (10, Sigmas(0.16, 0.05))])
def test_errors_are_those_of_the_graphs_that_the_pipeline_solves(
    reading: str, step: float, sigmas: Sigmas
) -> None:
    graphs = Graphs(120, step, 5, seed=3, reading=reading)
    errors = graphs.errors(sigmas)
    assert np.abs(errors).max() > 0.01
    for draw in range(5):
        np.testing.assert_allclose(errors[:, draw], solved(graphs, sigmas, draw), atol=1e-9)


def test_the_published_ratio_comes_about_where_errors_add_up_and_not_where_they_do_not() -> None:
    sigmas = Sigmas(cv=0.16, encoder=0.05)
    adding, literal = (Graphs(360, 10, 500, 0, reading).ratios(sigmas) for reading in READINGS)
    assert adding.of_means == pytest.approx(3.0, rel=0.1)
    assert adding.mean == pytest.approx(3.75, rel=0.1)
    assert literal.of_means < literal.mean < 0.5


def test_ratios_depend_on_the_ratio_of_both_noises_alone() -> None:
    graphs = Graphs(90, 12, 30, 1, "walk")
    one, ten = graphs.ratios(Sigmas(0.1, 0.05)), graphs.ratios(Sigmas(1.0, 0.5))
    assert ten.of_means == pytest.approx(one.of_means)
    assert ten.graph == pytest.approx(10 * one.graph)


def test_a_graph_that_knows_the_noise_beats_one_that_does_not() -> None:
    graphs, noise = Graphs(90, 12, 200, 1, "walk"), Sigmas(0.1, 0.3)
    informed = rmse(graphs.errors(noise)).mean()
    assert informed < 0.9 * rmse(graphs.errors(noise, Sigmas(0.1, 0.03))).mean()


def test_the_same_seed_gives_the_same_draws_and_another_seed_others() -> None:
    sigmas = Sigmas(0.1, 0.05)
    first, again, other = (Graphs(60, 12, 4, seed, "walk").errors(sigmas) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_differences_leave_out_the_first_angle() -> None:
    theta = np.array([0.0, 1.0, 4.0, 9.0])
    np.testing.assert_allclose(differences(4, 2) @ theta[1:], [4.0, 8.0])


def test_a_ratio_out_of_reach_is_told_as_such() -> None:
    study = ErrorRatio(angles=12, draws=20, steps_deg=(170,))
    found = study.same_accuracy(170)
    assert np.isnan(found.sigma_cv_deg)
    assert found.curve == {}
    assert "out of reach" in reach_said(170, found)


def test_crossing_is_found_on_any_scale_and_nowhere_where_there_is_none() -> None:
    assert crossing(lambda x: x**2, 1e-4) == pytest.approx(0.01, rel=1e-3)
    assert crossing(lambda x: 1 / x, 50) == pytest.approx(0.02, rel=1e-3)
    assert np.isnan(crossing(lambda x: np.exp(-x), 2))
