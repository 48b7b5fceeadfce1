"""A memory card: a thin board full of metal, very different face on and edge on."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.products import Floats
from tomoslam_stage.simulation.bodies import Box, Cylinder, Ellipsoid, Solids
from tomoslam_stage.simulation.placing import frames_along, upright

WIDTH, HEIGHT, THICKNESS = 92.0, 112.0, 6.0
"""px in a field of radius 150: half lengths of the card."""
LAYERS = (-4.6, -2.6)
"""px: depths of the two copper layers in the card."""
DIE_TOP = 3.0
"""px: depth of the top of the stack of dies."""

# Attenuation per px in a field of radius 150.
MOULD, LAMINATE, SILICON = 0.009, 0.005, 0.011
COPPER, SOLDER, GOLD, CERAMIC = 0.05, 0.06, 0.16, 0.03


@method
class Card:
    """A micro-SD-like card, upright, off the axis and leaning a little.

    Mould, laminate, stacked dies, contact pads, buses of copper traces, vias, bond wires, solder
    balls and capacitors. Seen edge on, everything lies behind everything else.
    """

    seed: int = 1
    traces: Annotated[int, Field(ge=0)] = 150
    """Number of straight pieces of trace."""
    vias: Annotated[int, Field(ge=0)] = 80
    """Number of vias through the laminate."""
    wires: Annotated[int, Field(ge=0)] = 44
    """Number of bond wires, each of three pieces."""
    balls: Annotated[int, Field(ge=0)] = 40
    """Number of solder balls."""
    capacitors: Annotated[int, Field(ge=0)] = 12
    """Number of capacitors, each with two end caps."""
    offset: Annotated[float, Field(ge=0, le=40)] = 18.0
    """px in a field of radius 150: from the axis to the middle of the card."""
    lean_deg: Annotated[float, Field(ge=-3, le=3)] = 2.0
    """Lean of the card, forward and sideways."""
    turn_deg: float = 17.0
    """The card is seen face on when theta is this."""

    def solids(self) -> tuple[Solids, ...]:
        """Every part of the card."""
        rng = np.random.default_rng(self.seed)
        parts = [
            *_boards(),
            *_dies(),
            _contacts(),
            _traces(self.traces, rng),
            _vias(self.vias, rng),
            *_wires(self.wires, rng),
            _balls(self.balls, rng),
            *_capacitors(self.capacitors, rng),
        ]
        shift = np.array([0.8 * self.offset, 0.0, 0.6 * self.offset])
        return tuple(part.moved(self._stand(), shift) for part in parts)

    def _stand(self) -> Floats:
        """(3, 3) turn of the card's own (across, down, through) into (X, Y, Z)."""
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_euler("ZXY", [self.lean_deg / 2, self.lean_deg, 0], degrees=True)
        # A rotation about Y by minus theta takes X to the direction of u at theta.
        about_axis = Rotation.from_euler("Y", -self.turn_deg, degrees=True)
        return np.asarray((about_axis * turn).as_matrix())


def _plates(centre: Floats, half: Floats, density: float) -> Solids:
    """Boxes along the card's own axes."""
    n = len(centre)
    return Solids(Box(), centre, upright(n), half, np.full(n, density))


def _boards() -> list[Solids]:
    mould = _plates(np.zeros((1, 3)), np.array([[WIDTH, HEIGHT, THICKNESS]]), MOULD)
    laminate_half = np.array([[WIDTH - 1, HEIGHT - 1, 1.6]])
    return [mould, _plates(np.array([[0.0, 0.0, np.mean(LAYERS)]]), laminate_half, LAMINATE)]


def _dies() -> list[Solids]:
    """Four memory dies, each set back from the one below, and the controller."""
    floor = -1.2 + 1.05 * np.arange(4)
    memory = np.stack([-8 + 4.0 * np.arange(4), np.full(4, -38.0), floor], axis=1)
    half = np.tile([62.0, 46.0, 0.45], (4, 1))
    controller = _plates(np.array([[-40.0, 44.0, -0.9]]), np.array([[19.0, 15.0, 0.7]]), SILICON)
    return [_plates(memory, half, SILICON), controller]


def _contacts() -> Solids:
    """Eight contact fingers on the back."""
    across = np.linspace(-0.8 * WIDTH, 0.8 * WIDTH, 8)
    centre = np.stack([across, np.full(8, HEIGHT - 14), np.full(8, -5.6)], axis=1)
    centre[[2, 5], 1] -= 4
    return _plates(centre, np.tile([7.0, 10.0, 0.4], (8, 1)), COPPER)


def _traces(n: int, rng: np.random.Generator) -> Solids:
    """Buses of parallel traces in four directions on two layers."""
    bus = np.arange(n) // 6
    buses = n // 6 + 1
    turn = rng.choice(np.deg2rad([0, 45, 90, 135]), buses, p=[0.25, 0.2, 0.35, 0.2])[bus]
    length = rng.uniform(14, 52, buses)[bus] * rng.uniform(0.7, 1, n)
    along = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    across = np.stack([-np.sin(turn), np.cos(turn), np.zeros(n)], axis=1)
    pitch = rng.uniform(3.2, 5.5, buses)[bus]
    aside = across * (pitch * (np.arange(n) % 6 - 2.5))[:, None]
    reach = np.abs(along[:, :2]) * 26 + np.abs(across[:, :2]) * 14
    middle = rng.uniform(-1, 1, (buses, 2))[bus] * ([WIDTH - 3, HEIGHT - 3] - reach)
    centre = aside + np.column_stack([middle, rng.choice(LAYERS, buses)[bus]])
    half = np.stack([length / 2, rng.uniform(0.6, 1.2, n), np.full(n, 0.5)], axis=1)
    axes = np.stack([along, across, np.tile([0.0, 0.0, 1.0], (n, 1))], axis=1)
    return Solids(Box(), centre, axes, half, np.full(n, COPPER))


def _vias(n: int, rng: np.random.Generator) -> Solids:
    place = rng.uniform(-1, 1, (n, 2)) * [WIDTH - 5, HEIGHT - 5]
    centre = np.column_stack([place, np.full(n, np.mean(LAYERS))])
    half = np.column_stack([np.repeat(rng.uniform(0.9, 1.6, (n, 1)), 2, axis=1), np.full(n, 1.4)])
    return Solids(Cylinder(), centre, upright(n), half, np.full(n, SOLDER))


def _wires(n: int, rng: np.random.Generator) -> list[Solids]:
    """Bond wires from the edges of the top die to pads on the laminate, and those pads."""
    side = np.where(np.arange(n) % 2, 1.0, -1.0)
    down = np.linspace(-80, 4, n) + rng.uniform(-0.8, 0.8, n)
    top = np.stack([4 + side * 59, down, np.full(n, DIE_TOP - 0.6)], axis=1)
    foot = np.stack([4 + side * rng.uniform(74, 84, n), down, np.full(n, LAYERS[1])], axis=1)
    foot[:, 1] += rng.uniform(-2.5, 2.5, n)
    rise = np.array([0.0, 0.0, 2.2])
    bends = [top, top + 0.25 * (foot - top) + rise, top + 0.7 * (foot - top) + rise, foot]
    rods = [_rods(a, b, 0.55) for a, b in pairwise(bends)]
    return [*rods, _plates(foot, np.tile([1.8, 1.1, 0.4], (n, 1)), COPPER)]


def _rods(start: Floats, end: Floats, radius: float) -> Solids:
    """Thin cylinders of gold from point to point, (n, 3) px each."""
    way = end - start
    half = np.column_stack(
        [np.full((len(way), 2), radius), np.linalg.norm(way, axis=1, keepdims=True) / 2]
    )
    axes = frames_along(way, np.array([0.0, 1.0, 0.0]))
    return Solids(Cylinder(), (start + end) / 2, axes, half, np.full(len(way), GOLD))


def _balls(n: int, rng: np.random.Generator) -> Solids:
    place = rng.uniform([-WIDTH + 8, 18], [WIDTH - 8, HEIGHT - 30], (n, 2))
    radius = rng.uniform(1.2, 2.8, n)
    centre = np.column_stack([place, LAYERS[1] + radius])
    half = np.repeat(radius[:, None], 3, axis=1)
    return Solids(Ellipsoid(), centre, upright(n), half, np.full(n, SOLDER))


def _capacitors(n: int, rng: np.random.Generator) -> list[Solids]:
    place = rng.uniform([-WIDTH + 10, 20], [WIDTH - 10, HEIGHT - 32], (n, 2))
    centre = np.column_stack([place, np.full(n, 0.0)])
    cap = np.array([2.9, 0.0, 0.0])
    ends = np.concatenate([centre - cap, centre + cap])
    return [
        _plates(centre, np.tile([2.2, 1.6, 1.6], (n, 1)), CERAMIC),
        _plates(ends, np.tile([0.7, 1.8, 1.8], (2 * n, 1)), SOLDER),
    ]
