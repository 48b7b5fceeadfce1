"""Where phantoms put their parts.

Phantoms are drawn in a field of one size and scaled to the detector's afterwards, so that a finer
detector sees the same object with finer pixels.
"""

from __future__ import annotations

import numpy as np

from tomoslam_stage.products import Floats
from tomoslam_stage.simulation.bodies import Cylinder, Solids

FIELD_RADIUS = 150.0
"""px: nothing may lie farther from the axis."""
FIELD_HALF_HEIGHT = 118.0
"""px: nothing may lie higher or lower, so that a detector of 4 by 5 sees all of it."""

TRIES, AT_ONCE = 25, 8
"""How often a sphere is tried in how many places at once, before it is left out."""


def upright(n: int) -> Floats:
    """(n, 3, 3) axes along X, Y and Z."""
    return np.tile(np.eye(3), (n, 1, 1))


def random_axes(n: int, rng: np.random.Generator) -> Floats:
    """(n, 3, 3) orthonormal axes, evenly distributed over all orientations."""
    a, b = rng.normal(size=(2, n, 3))
    return frames_along(a, b)


def frames_along(direction: Floats, aside: Floats) -> Floats:
    """(n, 3, 3) orthonormal axes, the third along `direction` (n, 3), the first near `aside`."""
    third = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    second = np.cross(third, aside)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([np.cross(second, third), second, third], axis=1)


def column(radius: float, half_height: float, density: float) -> Solids:
    """One cylinder around the rotation axis; lengths in px."""
    axes = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])
    half = np.array([[radius, radius, half_height]])
    return Solids(Cylinder(), np.zeros((1, 3)), axes, half, np.array([density]))


def packed_spheres(
    radii: Floats, within: tuple[float, float], rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Place spheres at random where they overlap none of the others, the largest first.

    Parameters
    ----------
    radii
        (n,) px.
    within
        px: radius and half height of the upright cylinder they must lie in.
    rng
        Draws the places.

    Returns
    -------
    centres, radii
        (m, 3) and (m,) px, m up to n: a sphere that finds no place is left out.
    """
    radii = np.sort(radii)[::-1]
    centres = np.empty((len(radii), 3))
    placed = np.zeros(len(radii), dtype=bool)
    for k, radius in enumerate(radii):
        others, room = centres[placed], (radii[placed] + radius) ** 2
        for _ in range(TRIES):
            places = _points_in_column(within[0] - radius, within[1] - radius, rng)
            free = (((places[:, None] - others) ** 2).sum(axis=2) > room).all(axis=1)
            if free.any():
                placed[k], centres[k] = True, places[np.argmax(free)]
                break
    return centres[placed], radii[placed]


def _points_in_column(radius: float, half_height: float, rng: np.random.Generator) -> Floats:
    r, turn = radius * np.sqrt(rng.random(AT_ONCE)), rng.uniform(0, 2 * np.pi, AT_ONCE)
    down = rng.uniform(-half_height, half_height, AT_ONCE)
    return np.stack([r * np.cos(turn), down, r * np.sin(turn)], axis=1)
