from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tomoslam_stage.simulation.bodies import Blob, Body, Box, Cylinder, Ellipsoid, Solids
from tomoslam_stage.simulation.placing import random_axes, upright
from tomoslam_stage.simulation.shadows import Frame, line_integrals, projection_directions

BODIES: dict[str, Body] = {
    "ellipsoid": Ellipsoid(),
    "box": Box(),
    "cylinder": Cylinder(),
    "blob": Blob(),
}
VOLUME = {
    "ellipsoid": 4 / 3 * np.pi,
    "box": 8.0,
    "cylinder": 2 * np.pi,
    "blob": (2 * np.pi) ** 1.5,
}
SHAPE = (90, 110)
MIDDLE = (55.3, 44.2)


def one(body: Body, seed: int = 0, size: float = 6.0) -> Solids:
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-8, 8, (1, 3))
    half = size * rng.uniform(0.3, 1.2, (1, 3))
    return Solids(body, centre, random_axes(1, rng), half, np.array([0.02]))


def marched(
    solids: Solids, directions: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Integrate along the depth by counting small steps; `points` (m, 2) column and row, px."""
    step = 0.005
    depth = np.arange(-60, 60, step) + step / 2
    total = np.zeros(len(points))
    for k, (x, y) in enumerate(points):
        seen = np.stack([np.full_like(depth, x), np.full_like(depth, y), depth], axis=1)
        space = seen @ directions
        for n in range(len(solids.centre)):
            q = solids.axes[n] @ (space - solids.centre[n]).T / solids.half[n][:, None]
            total[k] += solids.density[n] * solids.body.fill(q).sum() * step
    return total


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_chords_are_what_marching_through_the_body_finds(name: str, seed: int) -> None:
    solids = one(BODIES[name], seed)
    directions = projection_directions(0.7 + seed, roll=0.1)
    middle = (solids.centre @ directions.T)[0, :2]
    points = middle + np.random.default_rng(5).uniform(-6, 6, (40, 2))
    x, y = (points - middle).T
    shadow = solids.body.shadow(solids.local(directions))
    chords = solids.density * solids.body.chord(np.repeat(shadow, 40, axis=1), x, y)
    expected = marched(solids, directions, points)
    assert expected.max() > 0.05
    np.testing.assert_allclose(chords, expected, atol=0.02 * 0.012)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("theta", [0.0, 0.4, np.pi / 2, 2.9])
def test_projection_holds_the_mass_of_the_body_at_every_angle(name: str, theta: float) -> None:
    solids = one(BODIES[name], size=4.0)
    frame = Frame(projection_directions(theta, 0.0), MIDDLE, SHAPE)
    expected = VOLUME[name] * solids.half.prod() * 0.02
    assert line_integrals([solids], frame).sum() == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("name", ["box", "cylinder"])
@pytest.mark.parametrize("theta", [0.0, np.pi / 2, np.pi])
def test_rays_along_a_face_or_an_axis_see_the_full_length(name: str, theta: float) -> None:
    solids = Solids(
        BODIES[name], np.zeros((1, 3)), upright(1), np.array([[5.0, 5.0, 5.0]]), np.array([0.1])
    )
    frame = Frame(projection_directions(theta, 0.0), (20.0, 20.0), (41, 41))
    assert line_integrals([solids], frame)[20, 20] == pytest.approx(1.0, rel=0.03)


def test_a_face_that_ends_between_pixels_fills_its_pixel_in_part() -> None:
    half = np.array([[3.25, 3.25, 3.25]])
    box = Solids(Box(), np.zeros((1, 3)), upright(1), half, np.array([1.0]))
    frame = Frame(projection_directions(0.0, 0.0), (10.0, 10.0), (21, 21))
    picture = line_integrals([box], frame)
    np.testing.assert_allclose(picture[10, 6:9], [0.0, 0.75 * 6.5, 6.5])
    np.testing.assert_allclose(picture[6:9, 10], [0.0, 0.75 * 6.5, 6.5])


@pytest.mark.parametrize("name", BODIES)
def test_nothing_of_a_body_lies_beyond_its_reach(name: str) -> None:
    solids = one(BODIES[name], seed=3)
    rng = np.random.default_rng(0)
    directions = projection_directions(1.1, 0.2)
    p = solids.centre + rng.uniform(-30, 30, (200_000, 3))
    q = solids.axes[0] @ (p - solids.centre).T / solids.half[0][:, None]
    inside = solids.body.fill(q) > 1e-6
    farthest = np.abs((p - solids.centre)[inside] @ directions.T).max(axis=0)
    reach = solids.reach(directions)[0]
    assert np.all(farthest <= reach)
    assert np.all(farthest > 0.75 * np.minimum(reach, 30))


def test_scaled_solids_throw_the_same_shadow_on_a_finer_detector() -> None:
    solids = one(Ellipsoid(), seed=2)
    directions = projection_directions(0.3, 0.0)
    coarse = line_integrals([solids], Frame(directions, (50.5, 40.5), (80, 100)))
    fine = line_integrals([solids.scaled(2.0)], Frame(directions, (101.5, 81.5), (160, 200)))
    binned = fine.reshape(80, 2, 100, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(binned, coarse, atol=0.03 * coarse.max())
    assert binned.sum() == pytest.approx(coarse.sum(), rel=2e-3)
