from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.mapping.curvature import _combs, learn, lift, looks_needed, probed
from tomoslam_stage.mapping.looking import Look
from tomoslam_stage.products import UNKNOWNS, Floats, Geometry, Layout

HEIGHTS = np.array([-20.0, -5.0, 3.0, 24.0])


class Parabola:
    """Rows that pull towards a place with a curvature that fades over some degrees of half turn."""

    def __init__(self, theta: Floats, reach_deg: float = 2.0) -> None:
        n = len(theta)
        apart = np.mod(theta[:, None] - theta + np.pi / 2, np.pi) - np.pi / 2
        near = np.exp(-((np.rad2deg(apart) / reach_deg) ** 2) / 2)
        own = np.zeros((n + 1, n + 1))
        own[:n, :n] = 2 * np.eye(n) - 0.5 * near / near.sum(axis=1).mean()
        own[:n, n] = own[n, :n] = 0.02 * np.cos(theta)
        own[n, n] = 5.0
        self.start = Geometry(theta, 30.0)
        self.rows = [self._of_row(own, height) for height in HEIGHTS]
        self.curvature = np.asarray(sum(self.rows))

    def _of_row(self, own: Floats, height: float) -> Floats:
        seen = np.eye(len(own) + 1)[:-1]
        seen[-1, -1] = height
        return np.asarray(seen.T @ own @ seen)

    def look(self, geometry: Geometry) -> Look:
        change = np.append(
            geometry.theta - self.start.theta, [geometry.axis - self.start.axis, geometry.roll]
        )
        pulls = np.array([-row @ change for row in self.rows])
        n = len(geometry.theta)
        conditional = np.append(np.full(n, 8.0), np.diag(self.curvature)[n:])
        return Look(pulls, conditional, np.ones((4, n)), HEIGHTS, np.zeros(n))


class Jittery:
    """Rows that pull towards a place of angles and shifts; in the mirror shifts go the other way.

    A map that follows takes from each what is smooth over some degrees of half turn.
    """

    def __init__(self, theta: Floats) -> None:
        n = len(theta)
        self.start = Geometry(theta, 30.0, unknowns=UNKNOWNS)
        side = np.where(np.mod(theta, 2 * np.pi) < np.pi, 1.0, -1.0)
        apart = np.mod(theta[:, None] - theta + np.pi / 2, np.pi) - np.pi / 2
        near = np.exp(-((np.rad2deg(apart) / 2) ** 2) / 2)
        near /= near.sum(axis=1).mean()
        self.mixed = 0.3 * np.cos(theta)
        angles = 2 * np.eye(n) - 0.5 * near
        shifts = 1.5 * np.eye(n) - 0.3 * np.outer(side, side) * near
        both = np.diag(self.mixed) - 0.1 * near * side
        self.own = np.block([[angles, both], [both.T, shifts]])
        self.entries = np.r_[0:n, n + 2 : 2 * n + 2]

    def look(self, geometry: Geometry) -> Look:
        n, change = len(geometry.theta), geometry.since(self.start)
        pulls = np.zeros((4, len(change)))
        pulls[:, self.entries] = -self.own @ change[self.entries] / 4
        pulls[:, n] = -change[n] / 4
        conditional = np.r_[np.full(n, 2.0), 1.0, 1.0, np.full(n, 1.5)]
        return Look(pulls, conditional, np.ones((4, n)), HEIGHTS, self.mixed)


def angles(n: int) -> Floats:
    return np.random.default_rng(4).permutation(np.arange(n) * 2 * np.pi / n)


@pytest.mark.parametrize("n", [37, 120, 500])
def test_probing_finds_the_curvature(n: int) -> None:
    parabola = Parabola(angles(n))
    found = probed(parabola.look, parabola.start, 1e-3).curvature
    off = np.abs(found - parabola.curvature)
    # Two neighbours of five hundred share what they answer, ever so little of it.
    assert off[:n, :n].max() < 0.02 * np.diag(parabola.curvature)[:n].min()
    assert off[n:].max() < 1e-3 * parabola.curvature[n, n]


@pytest.mark.parametrize("n", [120, 500])
def test_probing_finds_how_angles_and_shifts_hang_together(n: int) -> None:
    jittery = Jittery(angles(n))
    found = probed(jittery.look, jittery.start, 1e-3).curvature
    off = np.abs(found[np.ix_(jittery.entries, jittery.entries)] - jittery.own)
    # Two neighbours of five hundred share what they answer, ever so little of it.
    assert off.max() < (1e-4 if n == 120 else 0.02)


@pytest.mark.parametrize("n", [20, 37, 360, 361, 401, 3600])
def test_the_combs_move_each_place_once_and_are_few(n: int) -> None:
    combs = list(_combs(n))
    moved = np.concatenate([np.concatenate(comb) for comb in combs])
    assert np.array_equal(np.sort(moved), np.arange(n))
    assert len(combs) <= 40
    assert looks_needed(Layout(n)) <= 48
    assert looks_needed(Layout(n, UNKNOWNS)) == looks_needed(Layout(n)) + len(combs)


def test_a_raised_curvature_keeps_what_is_high_enough() -> None:
    conditional = np.array([1.0, 4.0, 9.0, 1.0])
    found = np.diag([-1.0, 2.0, 0.9, 1.0])
    lift(found, conditional, 0.25, Layout(2))
    np.testing.assert_allclose(found, np.diag([0.25, 2.0, 2.25, 1.0]), atol=1e-12)


def test_a_secant_makes_the_curvature_answer_as_it_was_seen_to() -> None:
    change, answer = np.array([1.0, 2.0, 0.0]), np.array([1.5, 0.5, 1.0])
    found = np.eye(3)
    learn(found, change, answer, np.ones(3))
    np.testing.assert_allclose(found @ change, answer)
    assert np.linalg.eigvalsh(found).min() > 0


def test_a_secant_downhill_leaves_the_curvature_positive() -> None:
    change = np.array([1.0, 2.0, 0.0])
    found = np.eye(3)
    learn(found, change, -change, np.ones(3))
    assert np.linalg.eigvalsh(found).min() == pytest.approx(0.02)


def test_secants_that_contradict_each_other_leave_the_curvature_within_bounds() -> None:
    rng = np.random.default_rng(6)
    curvature, conditional = np.diag([3.0, 1.0, 50.0]), np.array([3.0, 1.0, 50.0])
    for _ in range(60):
        learn(curvature, rng.normal(size=3), 9 * rng.normal(size=3), conditional)
    scale = np.sqrt(conditional)
    values = np.linalg.eigvalsh(curvature / np.outer(scale, scale))
    assert values.min() > 1e-4
    assert values.max() < 10
