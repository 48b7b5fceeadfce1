from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.simulation import PHANTOMS, Recipe, recipe_from, simulate
from tomoslam_stage.simulation.bodies import BLOB_REACH
from tomoslam_stage.simulation.placing import FIELD_RADIUS, packed_spheres, random_axes
from tomoslam_stage.simulation.shadows import projection_directions


def small(name: str, **changes: object) -> Recipe:
    return recipe_from({"phantom": name, "rows": 64, "columns": 80, "n_projections": 8, **changes})


@pytest.mark.parametrize("name", PHANTOMS)
def test_phantom_stays_in_the_field_all_the_way_round(name: str) -> None:
    # Blobs are allowed out where their line integrals have fallen to e^-8.
    share = 4 / BLOB_REACH if name == "smooth" else 1
    for group in PHANTOMS[name]().solids():
        for theta in np.linspace(0, np.pi, 19):
            directions = projection_directions(theta, 0.0)
            column = np.abs(group.centre @ directions[0])
            assert np.all(column + share * group.reach(directions)[:, 0] <= FIELD_RADIUS)


@pytest.mark.parametrize("name", PHANTOMS)
def test_projections_hold_the_same_mass_at_all_angles(name: str) -> None:
    scan = simulate(small(name))
    mass = [scan.line_integrals(k).sum() for k in range(8)]
    assert np.ptp(mass) < 4e-3 * np.mean(mass)


@pytest.mark.parametrize("name", PHANTOMS)
def test_axes_of_all_parts_are_orthonormal(name: str) -> None:
    for group in PHANTOMS[name]().solids():
        product = group.axes @ group.axes.transpose(0, 2, 1)
        np.testing.assert_allclose(product, np.tile(np.eye(3), (len(product), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("name", PHANTOMS)
def test_line_integrals_stay_within_what_a_detector_can_see(name: str) -> None:
    scan = simulate(small(name, n_projections=16))
    pictures = np.stack([scan.line_integrals(k) for k in range(16)])
    assert pictures.min() > -1e-9
    assert 0.3 < np.percentile(pictures, 99.5) < 4
    assert pictures.max() < 8


@pytest.mark.parametrize("name", PHANTOMS)
def test_another_seed_is_another_object(name: str) -> None:
    one, other = PHANTOMS[name](), recipe_from({"phantom": {"method": name, "seed": 2}}).phantom
    assert not np.array_equal(one.solids()[-1].centre, other.solids()[-1].centre)


def test_card_is_thick_seen_edge_on_and_thin_seen_face_on() -> None:
    turn = {"method": "card", "turn_deg": 30.0}
    recipe = small("card", phantom=turn, n_projections=12, angle_errors=[])
    width = [(simulate(recipe).line_integrals(k) > 0.05).any(axis=0).sum() for k in range(12)]
    assert int(np.argmax(width[:6])) == 1
    assert int(np.argmin(width[:6])) == 4
    assert max(width) > 5 * min(width)


def test_packed_spheres_overlap_nowhere_and_stay_inside() -> None:
    rng = np.random.default_rng(0)
    centres, radii = packed_spheres(rng.uniform(2, 6, 150), (40.0, 30.0), rng)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) + np.diag(np.full(len(radii), 99))
    assert np.all(apart > radii[:, None] + radii)
    assert np.all(np.hypot(centres[:, 0], centres[:, 2]) + radii <= 40)
    assert np.all(np.abs(centres[:, 1]) + radii <= 30)


def test_spheres_without_a_place_are_left_out() -> None:
    centres, radii = packed_spheres(np.full(50, 6.0), (10.0, 10.0), np.random.default_rng(0))
    assert 1 <= len(centres) == len(radii) < 10


def test_random_axes_point_everywhere_alike() -> None:
    axes = random_axes(4000, np.random.default_rng(0))
    np.testing.assert_allclose(axes.mean(axis=0), 0, atol=0.05)
    np.testing.assert_allclose((axes**2).mean(axis=0), 1 / 3, atol=0.02)
