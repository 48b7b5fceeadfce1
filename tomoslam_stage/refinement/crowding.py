"""Projections in which features crowd: there all of them are pulled alike, towards the middle.

A keypoint gives way to what overlaps it. Where a flat object is seen nearly edge on, neighbours
overlap each sighting on the side of the middle more than on the other, and the object looks
narrower: by a tenth or two of a pixel, which turns the angle by .05 degrees while halves of the
features agree. It cannot be told from a turn there. What shows it is that sightings scatter more
than usual.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Geometry
    from tomoslam_stage.refinement.sightings import Sightings

BY_CHANCE = 2.0
"""Standard errors by which a projection may scatter more than usual for no reason."""
SLIGHT = 1e-12
"""Keeps from dividing by nothing where a projection has no sightings."""


def crowding(sightings: Sightings, geometry: Geometry, position: Floats, weights: Floats) -> Floats:
    """(n,) factors by which what sightings say about each angle is less sure than it seems.

    One, and more where they scatter more than usual, as if that scatter pulled them all towards
    the middle, as far as such a pull would turn the angle: not at all where columns tell nothing
    about depth, as in objects that are as deep as they are wide.

    Parameters
    ----------
    sightings
        Of features.
    geometry
        Where the projections look from.
    position
        (f, 2) px: where the features lie.
    weights
        (s,) px^-2: of the sightings.
    """
    n = geometry.layout.n

    def mean(values: Floats) -> Floats:
        return np.bincount(sightings.projection, weights * values, n) / together

    together = np.bincount(sightings.projection, weights, n) + SLIGHT
    (x, z), (cosine, sine) = position[sightings.feature].T, sightings.directions(geometry).T
    across, depth = x * cosine + z * sine, z * cosine - x * sine
    inward = across - mean(across)[sightings.projection]
    squared, by_angle = mean(inward**2) + SLIGHT, mean(depth**2) + SLIGHT
    turned = mean(inward * depth) ** 2 / (squared * by_angle**2)
    scatter = mean(sightings.residuals(geometry, position) ** 2)
    excess = _excess(scatter, together / (mean(weights) + SLIGHT))
    return np.asarray(1 + together * by_angle * turned * excess)


def _excess(scatter: Floats, alike: Floats) -> Floats:
    """(n,) px squared by which projections `scatter` (n,) more than usual, and than by chance.

    `alike` (n,) sightings of equal weight would be as many as each projection has.
    """
    seen = alike > 0
    if not seen.any():
        return np.zeros(len(scatter))
    usual = np.median(scatter[seen])
    chance = 1 + BY_CHANCE * np.sqrt(2 / np.where(seen, alike, np.inf))
    return np.asarray(np.maximum(scatter - usual * chance, 0))
