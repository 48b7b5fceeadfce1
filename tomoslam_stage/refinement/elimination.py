"""Bundle adjustment with the features eliminated (Schur complement).

A change of angles, axis, roll and shifts changes the residuals of a feature; the best change of
the feature's own place takes back what it can. What is left speaks about the geometry alone
(Triggs et al., Bundle adjustment: a modern synthesis, 2000, section 6.1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.products import Quadratic
from tomoslam_stage.refinement.sightings import SLIGHT
from tomoslam_stage.symmetric import add_gram, blocks

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Geometry, Layout
    from tomoslam_stage.refinement.sightings import Sightings

BLOCK = 2048
"""Rows of a dense product worked on at once: bounds the memory."""
FULL = 0.15
"""Matrices that are filled to this part are faster to multiply when they are taken for dense."""


@dataclass(frozen=True)
class Elimination:
    """What all features say about the geometry, and how they move with it."""

    quadratic: Quadratic
    """On changes of the geometry."""
    mixed: Any
    """(2 f, k) sparse: how the whitened places of features depend on the geometry."""
    pull: Floats
    """(2 f,) how far the residuals pull the whitened places."""
    root: tuple[Floats, Floats, Floats]
    """(f,) each: the entries 11, 21 and 22 of the Cholesky factors of the features' information."""

    def moves(self, change: Floats) -> Floats:
        """(f, 2) px: how features move along with a `change` (k,) of the geometry."""
        first, second = (self.pull - self.mixed @ change).reshape(2, -1)
        r11, r21, r22 = self.root
        z = second / r22
        return np.stack([(first - r21 * z) / r11, z], axis=1)


def eliminated(
    sightings: Sightings, geometry: Geometry, position: Floats, weights: Floats
) -> Elimination:
    """Eliminate the features at `position` (f, 2) px from sightings of `weights` (s,) px^-2."""
    directions, root = sightings.directions(geometry), np.sqrt(weights)
    residuals = root * sightings.residuals(geometry, position)
    by_geometry = _jacobian(sightings, geometry, position, directions).weighted(root)
    whitened, factors = _orthonormal(sightings, root[:, None] * directions)
    mixed = _mixed(sightings, whitened, by_geometry)
    pull = np.concatenate([sightings.sums(part * residuals) for part in whitened.T])
    left = _full(sightings, by_geometry, residuals)
    _take_gram(left.information, mixed)
    left.pull[:] -= mixed.T @ pull
    return Elimination(left, mixed, pull, factors)


@dataclass(frozen=True)
class Derivatives:
    """Of the columns of sightings, by the entries of a change that are not zero anyway."""

    layout: Layout
    """Of the change."""
    values: Floats
    """(s, o + 2) by what the projection has for itself, its angle and, where unknown, its shift;
    then by the axis and the roll."""

    @property
    def own(self) -> Floats:
        """(s, o) by what the projection has for itself."""
        return self.values[:, :-2]

    @property
    def common(self) -> Floats:
        """(s, 2) by the axis and the roll."""
        return self.values[:, -2:]

    def weighted(self, root: Floats) -> Derivatives:
        """Return them times `root` (s,)."""
        return replace(self, values=root[:, None] * self.values)


def _jacobian(
    sightings: Sightings, geometry: Geometry, position: Floats, directions: Floats
) -> Derivatives:
    """Return the derivatives of the columns."""
    x, z = position[sightings.feature].T
    cosine, sine = directions.T
    depth = z * cosine - x * sine
    moved = np.ones_like(depth)
    own = [depth, moved][: len(geometry.layout.own)]
    values = np.stack([*own, moved, sightings.row - geometry.middle], axis=1)
    return Derivatives(geometry.layout, values)


def _orthonormal(
    sightings: Sightings, by_place: Floats
) -> tuple[Floats, tuple[Floats, Floats, Floats]]:
    """(s, 2) derivatives by the places, made orthonormal in each feature, and how: L of L L'."""
    first, second = by_place.T
    r11 = np.sqrt(sightings.sums(first**2) + SLIGHT)
    r21 = sightings.sums(first * second) / r11
    r22 = np.sqrt(np.maximum(sightings.sums(second**2) + SLIGHT - r21**2, SLIGHT / 1000))
    f = sightings.feature
    one = first / r11[f]
    return np.stack([one, (second - r21[f] * one) / r22[f]], axis=1), (r11, r21, r22)


def _mixed(sightings: Sightings, whitened: Floats, by_geometry: Derivatives) -> Any:
    """(2 f, k) sparse: products of the derivatives by the places and by the geometry."""
    from scipy.sparse import csr_matrix

    layout = by_geometry.layout
    features, everyone = sightings.n_features, np.arange(sightings.n_features)
    values, rows, columns = [], [], []
    for which, part in enumerate(whitened.T):
        for entries, own in zip(layout.own, by_geometry.own.T, strict=True):
            values.append(part * own)
            rows.append(sightings.feature + which * features)
            columns.append(sightings.projection + entries.start)
        for entry, common in zip((layout.axis, layout.roll), by_geometry.common.T, strict=True):
            values.append(sightings.sums(part * common))
            rows.append(everyone + which * features)
            columns.append(np.full(features, entry))
    where = np.concatenate(rows), np.concatenate(columns)
    return csr_matrix((np.concatenate(values), where), (2 * features, layout.size))


def _full(sightings: Sightings, by_geometry: Derivatives, residuals: Floats) -> Quadratic:
    """Quadratic of the geometry with every feature held where it is."""
    layout, common = by_geometry.layout, by_geometry.common
    information, pull = np.zeros((layout.size, layout.size)), np.zeros(layout.size)

    def sums(values: Floats) -> Floats:
        return np.bincount(sightings.projection, values, layout.n).astype(np.float64, copy=False)

    kinds = list(zip(layout.own, by_geometry.own.T, strict=True))
    for entries, own in kinds:
        for others, other in kinds:
            np.fill_diagonal(information[entries, others], sums(own * other))
        information[entries, layout.line] = np.stack([sums(own * c) for c in common.T], axis=1)
        information[layout.line, entries] = information[entries, layout.line].T
        pull[entries] = sums(own * residuals)
    information[layout.line, layout.line] = common.T @ common
    pull[layout.line] = common.T @ residuals
    return Quadratic(information, pull)


def _take_gram(information: Floats, mixed: Any) -> None:
    """Take the product of the transpose of `mixed` (2 f, k) with itself off `information`."""
    rows, size = mixed.shape
    if mixed.nnz < FULL * rows * size:
        across = mixed.T.tocsr()
        for some in blocks(size):
            information[some] -= (across[some] @ mixed).toarray()
        return
    for start in range(0, rows, BLOCK):
        add_gram(information, mixed[start : start + BLOCK].toarray(), -1)
