"""Rows of features: they tell of a sample that moves by itself, and of a beam that spreads.

In a parallel beam a feature of a rigid sample keeps its row, but for an axis that leans:
``v = Y - roll u - pitch w``, w the depth. A beam that spreads adds ``kappa Y w``; a sample that
moves, and rows that follow it, add what changes as the scan goes on, here in parts of the scan:
``a + b Y + c u + d w``. Rows make no angle, so that wrong angles cannot hide what they show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.images import robust_scale
from tomoslam_stage.products import Rigidity
from tomoslam_stage.refinement.landmarks import placed
from tomoslam_stage.refinement.quality import usual_row
from tomoslam_stage.refinement.sightings import Sightings
from tomoslam_stage.refinement.weighing import Weighing

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Geometry, Integers, Tracks
    from tomoslam_stage.refinement.weighing import Strictness

PARTS = 12
"""Parts of the scan in each of which the sample may lie elsewhere."""
TILTS, CONE = 2, 2
"""Columns of the equations: how many for the axis, then which one for the beam."""
FEWEST = 100
"""Fewer features than this cannot tell so many numbers apart from their own errors."""
MOST_SIGHTINGS = 400_000
"""Where there are more, some features are asked only: this bounds the memory on long scans."""
ASTRAY = 3.0
"""Robust standard deviations from which on a column or a row belongs to something else."""
MISPLACED_PX = 1.0
"""Tracks whose columns usually miss by more are not those of a feature that the angles explain."""
SETTLED = 1e-9
"""Smallest eigenvalue of the normal equations that counts, in units of the largest."""


@dataclass(frozen=True)
class Level:
    """Sightings by where their features lie, and how far they are off their rows."""

    sightings: Sightings
    """Those that agree with the geometry."""
    where: Floats
    """(s, 3) height Y, column u and depth w, from the middle and the axis, each in units of its
    largest."""
    off: Floats
    """(s,) px: row, the roll taken off, less that of the feature."""


def rigidity(
    tracks: Tracks, geometry: Geometry, strictness: Strictness, pixel: int
) -> Rigidity | None:
    """Tell what the rows of `tracks` say; None where too few tracks agree with `geometry`.

    `pixel` is how many px of the file a px of the tracks spans.
    """
    every = max(1, -(-tracks.n_sightings // MOST_SIGHTINGS))
    asked = agreeing(tracks.chosen(tracks.feature % every == 0), geometry, strictness)
    if asked.n_features < FEWEST:
        return None
    level = levelled(asked, geometry)
    design = _design(level, len(geometry.theta))
    change, covariance, normal = regressed(design, level.off, level.sightings)
    moved = _moved(normal / len(level.off))
    spread = covariance @ moved
    # Noise alone moves rows, too: by the trace, and that scatters by the root.
    square = float(change @ moved @ change - np.trace(spread))
    scatter = float(np.sqrt(2 * np.trace(spread @ spread)))
    cone_sigma = float(np.sqrt(covariance[CONE, CONE]))
    return Rigidity(
        features=asked.n_features,
        moved_px=pixel * float(np.sqrt(max(square, 0.0))),
        moved_significance=square / scatter if scatter > 0 else 0.0,
        cone_px=pixel * float(change[CONE]),
        cone_significance=float(change[CONE]) / cone_sigma if cone_sigma > 0 else 0.0,
        pixel=pixel,
    )


def agreeing(tracks: Tracks, geometry: Geometry, strictness: Strictness) -> Tracks:
    """Return the sightings of `tracks` whose columns and rows agree with `geometry`."""
    sightings = Sightings.of(tracks, geometry.theta)
    position, weights = placed(sightings, geometry, Weighing.of(strictness, sightings, geometry))
    residuals = sightings.residuals(geometry, position)
    missed = np.sqrt(sightings.means(residuals**2, weights))
    rows = geometry.level(sightings.column, sightings.row, sightings.projection)
    level = replace(sightings, row=rows)
    off = level.row - usual_row(level)[level.feature]
    # A place that only a short arc tells may lie anywhere, far outside what was seen.
    seen = np.abs(sightings.column - geometry.axis).max(initial=0.0)
    sound = (missed < MISPLACED_PX) & (np.hypot(*position.T) <= seen)
    agree = sound[level.feature]
    for each in (residuals, off):
        agree &= np.abs(each) <= ASTRAY * robust_scale(each)
    return tracks.chosen(np.sort(sightings.order[agree]))


def levelled(tracks: Tracks, geometry: Geometry) -> Level:
    """Tell where the features of `tracks` lie, and how far sightings are off their rows."""
    sightings = Sightings.of(tracks, geometry.theta)
    everyone = np.ones(len(sightings.feature))
    position = sightings.positions(geometry, everyone)[sightings.feature]
    cosine, sine = sightings.directions(geometry).T
    x, z = position.T
    rows = geometry.level(sightings.column, sightings.row, sightings.projection)
    usual = sightings.means(rows, everyone)[sightings.feature]
    where = np.stack([usual - geometry.middle, x * cosine + z * sine, z * cosine - x * sine], 1)
    reach = np.maximum(np.abs(where).max(axis=0), 1.0)
    return Level(sightings, where / reach, rows - usual)


def _design(level: Level, n: int) -> Any:
    """(s, c) sparse: the tilts of the axis, the cone, then for each part of the scan four."""
    from scipy.sparse import csr_matrix, hstack

    y, u, w = level.where.T
    part = level.sightings.projection * PARTS // n
    each = np.stack([np.ones_like(y), y, u, w], axis=1)
    columns = 4 * part[:, None] + np.arange(4)
    rows = np.broadcast_to(np.arange(len(y))[:, None], columns.shape)
    moving = csr_matrix((each.ravel(), (rows.ravel(), columns.ravel())), (len(y), 4 * PARTS))
    return hstack([csr_matrix(np.stack([u, w, y * w], axis=1)), moving]).tocsr()


def regressed(design: Any, off: Floats, sightings: Sightings) -> tuple[Floats, Floats, Floats]:
    """Solve `design` (s, c) for `off` (s,) px, the mean of each feature left open.

    Returns the solution (c,), the shortest where some are open; its covariance (c, c), in which
    the features are what errs independently, however the sightings of one hang together (Liang and
    Zeger, Biometrika 73 (1986) 13); and the matrix (c, c) of the normal equations.
    """
    counts = sightings.counts[:, None]
    of_feature = _incidence(sightings.feature)
    sums = (of_feature @ design).toarray()
    normal = (design.T @ design).toarray() - sums.T @ (sums / counts)
    inverse = np.linalg.pinv(normal, rcond=SETTLED, hermitian=True)
    change = inverse @ (design.T @ off)
    means = (sums @ change) / counts[:, 0]
    left = off - (design @ change - means[sightings.feature])
    scores = (of_feature @ design.multiply(left[:, None]).tocsr()).toarray() @ inverse
    features, unknowns = sums.shape
    covariance = scores.T @ scores * features / max(features - unknowns, 1)
    return change, covariance, normal


def _incidence(feature: Integers) -> Any:
    """(f, s) sparse: 1 where the sighting belongs to the feature."""
    from scipy.sparse import csr_matrix

    everyone = np.arange(len(feature))
    return csr_matrix((np.ones(len(feature)), (feature, everyone)))


def _moved(normal: Floats) -> Floats:
    """(c, c) the quadratic form of what only parts of the scan explain, and no tilt of the axis."""
    parts = slice(CONE + 1, None)
    form = np.zeros_like(normal)
    tilts, mixed = normal[:TILTS, :TILTS], normal[:TILTS, parts]
    form[parts, parts] = (
        normal[parts, parts] - mixed.T @ np.linalg.pinv(tilts, rcond=SETTLED) @ mixed
    )
    return form
