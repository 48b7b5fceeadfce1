from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.simulation import Recipe, recipe_from, simulate
from tomoslam_stage.simulation.bodies import Ellipsoid, Solids
from tomoslam_stage.simulation.placing import upright
from tomoslam_stage.simulation.sample_motions import (
    SAMPLE_MOTIONS,
    Drifting,
    Leaning,
    SampleMotion,
    Shaking,
    Slipping,
    Swelling,
)
from tomoslam_stage.simulation.shadows import magnified

SMALL = {"phantom": {"method": "grains", "grains": 20}, "rows": 40, "columns": 64, "seed": 2}


@pytest.fixture
def balls() -> Solids:
    """Two balls, the first above the middle."""
    centre = np.array([[10.0, -20.0, 5.0], [-8.0, 15.0, 3.0]])
    return Solids(Ellipsoid(), centre, upright(2), np.full((2, 3), 4.0), np.full(2, 0.1))


def moved(motion: SampleMotion, group: Solids, when: float = 1.0, seed: int = 0) -> Solids:
    return motion.moved(group, when, np.random.default_rng(seed))


@pytest.mark.parametrize("name", set(SAMPLE_MOTIONS) - {"shaking"})
def test_a_steady_motion_begins_where_the_sample_is(name: str, balls: Solids) -> None:
    begun = moved(SAMPLE_MOTIONS[name](), balls, 0.0)
    np.testing.assert_allclose(begun.centre, balls.centre)
    assert not np.allclose(moved(SAMPLE_MOTIONS[name](), balls).centre, balls.centre)


@pytest.mark.parametrize("name", set(SAMPLE_MOTIONS) - {"swelling", "slipping"})
def test_a_rigid_motion_keeps_distances(name: str, balls: Solids) -> None:
    apart = np.diff(moved(SAMPLE_MOTIONS[name](), balls, 0.7).centre, axis=0)
    assert np.linalg.norm(apart) == pytest.approx(np.linalg.norm(np.diff(balls.centre, axis=0)))


def test_shaking_moves_all_parts_alike_and_every_projection_anew(balls: Solids) -> None:
    shift = moved(Shaking(sigma_px=2.0), balls).centre - balls.centre
    np.testing.assert_allclose(shift[0], shift[1])
    assert not np.allclose(shift, moved(Shaking(sigma_px=2.0), balls, seed=1).centre - balls.centre)
    many = [moved(Shaking(sigma_px=2.0), balls, seed=k).centre[0] for k in range(400)]
    np.testing.assert_allclose(np.std(many, axis=0), 2.0, rtol=0.15)


def test_drifting_is_half_way_in_the_middle_of_the_scan(balls: Solids) -> None:
    shift = moved(Drifting(x_px=6, y_px=2), balls, 0.5).centre - balls.centre
    np.testing.assert_allclose(shift, [[3, 1, 0]] * 2)


def test_leaning_turns_about_the_x_axis(balls: Solids) -> None:
    leant = moved(Leaning(angle_deg=90), balls).centre
    np.testing.assert_allclose(leant[0], [10, -5, -20], atol=1e-12)


def test_slipping_turns_what_lies_above_the_middle_alone(balls: Solids) -> None:
    slipped = moved(Slipping(angle_deg=90), balls).centre
    np.testing.assert_allclose(slipped, [[5, -20, -10], [-8, 15, 3]], atol=1e-12)


def test_swelling_keeps_the_shadows_as_dark(balls: Solids) -> None:
    grown = moved(Swelling(share=0.1), balls)
    np.testing.assert_allclose(grown.half, 4.4)
    np.testing.assert_allclose(grown.half[:, 0] * grown.density, balls.half[:, 0] * balls.density)


def test_a_cone_beam_shows_what_is_near_the_source_larger(balls: Solids) -> None:
    directions = np.eye(3)  # column X, row Y, depth Z
    seen = magnified(balls, directions, 100.0)
    factor = 100 / (100 + balls.centre[:, 2])
    np.testing.assert_allclose(seen.centre[:, :2], balls.centre[:, :2] * factor[:, None])
    np.testing.assert_allclose(seen.centre[:, 2], balls.centre[:, 2])
    np.testing.assert_allclose(seen.half[:, 0], 4 * factor)


def test_a_source_far_away_is_a_parallel_beam() -> None:
    parallel, far, near = (
        simulate(recipe_from(SMALL | {"n_projections": 5, "source_px": source}))
        for source in (None, 1e9, 150.0)
    )
    np.testing.assert_allclose(far.line_integrals(2), parallel.line_integrals(2), atol=1e-5)
    assert np.abs(near.line_integrals(2) - parallel.line_integrals(2)).max() > 0.05


def test_motions_come_out_the_same_in_any_order_and_another_run() -> None:
    motions = [{"method": "shaking"}, {"method": "drifting", "x_px": 3.0}]
    recipe = recipe_from(SMALL | {"n_projections": 5, "sample_motions": motions})
    assert recipe_from(recipe.described()) == recipe
    one, other = simulate(recipe), simulate(recipe)
    forwards = list(one.projections())
    for k in (3, 0, 4):
        np.testing.assert_array_equal(other.projection(k), forwards[k])
    still = simulate(recipe_from(SMALL | {"n_projections": 5}))
    assert np.abs(still.line_integrals(4) - one.line_integrals(4)).max() > 0.05


def test_a_sample_rests_unless_told_otherwise() -> None:
    assert Recipe().sample_motions == ()
    assert Recipe().source_px is None
