"""A cylinder of blobs whose rows differ, recorded with a wandering encoder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from tomoslam_stage.products import Floats, Geometry, Integers, Pixels, Quadratic, Scan, Solve

COLUMNS = 64
AXIS = 32.7
LOOSE = np.deg2rad(3.0)


@dataclass(frozen=True)
class Stack:
    """Line integrals (projection, row, column) held in memory."""

    values: Pixels

    @property
    def shape(self) -> tuple[int, int, int]:
        p, r, c = self.values.shape
        return p, r, c

    def read(self, projections: Integers, rows: Integers) -> Pixels:
        return self.values[projections][:, rows]


@dataclass(frozen=True)
class Known:
    """A scan and what is true about it."""

    scan: Scan
    true: Geometry

    def recorded(self) -> Geometry:
        """Where to begin: recorded angles, an axis a little off, no roll."""
        return Geometry(self.scan.theta, AXIS + 0.2, 0.0, self.true.middle)

    def error_deg(self, theta: Floats) -> float:
        return float(np.rad2deg(np.std(theta - self.true.theta)))


def blob_projections(true: Geometry, rows: int, rng: np.random.Generator) -> Pixels:
    """(n, r, column) of forty small discs blurred by a pixel, others in each row."""
    theta = true.theta
    stack = np.zeros((len(theta), rows, COLUMNS))
    for row, axis in enumerate(true.axis_at(np.arange(rows))):
        radius, angle = 26 * np.sqrt(rng.random(40)), rng.uniform(0, 2 * np.pi, 40)
        width, height = rng.uniform(1.2, 2.5, 40), rng.uniform(0.05, 0.2, 40)
        off = np.arange(COLUMNS) - axis - (radius * np.cos(theta[:, None] - angle))[..., None]
        stack[:, row] = np.einsum("b,nbc->nc", height, np.exp(-((off / width[:, None]) ** 2) / 2))
    return stack.astype(np.float32)


def scan_of(values: Pixels, recorded: Floats) -> Scan:
    return Scan(Stack(values), recorded, np.arange(len(recorded)))


def known(turn: float = 2 * np.pi, roll: float = 0.0, n: int = 90, rows: int = 12) -> Known:
    """Make a scan whose recorded angles wander off the true ones by 0.15 degrees a step."""
    rng = np.random.default_rng(5)
    recorded = np.arange(n) * turn / n
    truth = recorded + np.deg2rad(0.15) * np.cumsum(rng.standard_normal(n))
    true = Geometry(truth, AXIS, roll, (rows - 1) / 2)
    clean = blob_projections(true, rows, rng)
    noisy = clean + rng.normal(0, 0.01, clean.shape).astype(np.float32)
    return Known(scan_of(noisy, recorded), true)


@pytest.fixture(scope="session")
def walk() -> Known:
    return known()


@pytest.fixture(scope="session")
def making() -> Callable[..., Known]:
    return known


@pytest.fixture(scope="session")
def holding() -> Callable[[Floats], Solve]:
    """Make what solves with loose springs to the recorded angles and no roll, the axis free."""

    def held(recorded: Floats) -> Solve:
        spring = np.append(np.full(len(recorded), LOOSE**-2), [0.0, np.deg2rad(1.0) ** -2])

        def solve(geometry: Geometry, quadratic: Quadratic) -> Floats:
            off = np.append(geometry.theta - recorded, [0.0, geometry.roll])
            pull = quadratic.pull - spring * off
            return np.asarray(np.linalg.solve(quadratic.information + np.diag(spring), pull))

        return solve

    return held
