"""Sightings as landmarks: angles, axis, roll and shifts from where features were seen.

Every sighting says ``u = X cos(theta) + Z sin(theta) + axis + roll (row - middle) + shift``, the
shift of its projection, where the sample may have moved. The features (X, Z) are eliminated, what
is left goes to the factor graph, which weighs it against the encoder, and its answer moves geometry
and features (Gauss-Newton, iteratively reweighted).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.images import robust_scale
from tomoslam_stage.methods import method
from tomoslam_stage.parallel import on_one_thread
from tomoslam_stage.products import Features, Floats, Geometry, Quadratic
from tomoslam_stage.refinement.crowding import crowding
from tomoslam_stage.refinement.elimination import eliminated
from tomoslam_stage.refinement.leaning import hear_rows
from tomoslam_stage.refinement.sightings import Sightings
from tomoslam_stage.refinement.weighing import Weighing

if TYPE_CHECKING:
    from collections.abc import Callable

    from tomoslam_stage.products import Solve, Tracks

FIRST_ROUNDS = 3
"""Rounds of weighing before features are first trusted."""


@dataclass(frozen=True)
class Adjusted:
    """What the sightings of all features say together."""

    geometry: Geometry
    """Where the projections look from."""
    quadratic: Callable[[], Quadratic]
    """What the sightings say about changes of `geometry`, every feature free to move along; worked
    out where it is asked for, as it takes much memory."""
    features: Features
    """Where the features lie, in the order of their numbers."""
    residuals: Floats
    """(s,) px: columns sighted less columns expected, in the order of the tracks."""
    weights: Floats
    """(s,) px^-2: robust weights of the sightings, in the order of the tracks."""
    scale: float
    """px: robust standard deviation of the residuals."""
    inflation: float
    """By how much `quadratic` takes variances for larger, as errors are correlated along tracks."""


@method
class Landmarks:
    """Adjusts geometry and features to each other."""

    grip: Annotated[float, Field(gt=0)] = 2.0
    """Standard deviations at which a sighting has lost three quarters of its weight."""
    floor: Annotated[float, Field(gt=0)] = 0.05
    """px: no sighting is better than this."""
    common: Annotated[float, Field(ge=0)] = 10.0
    """Sightings' worth of belief that a track is no better and no worse than others."""
    rounds: Annotated[int, Field(ge=1)] = 15
    """At most so many Gauss-Newton steps."""
    settled_deg: Annotated[float, Field(gt=0)] = 1e-3
    """Largest change of an angle that counts as none, degrees."""
    correlated: Annotated[int, Field(ge=0)] = 40
    """Sightings along a track over which correlated errors are looked for; 0: taken for none."""

    def adjust(self, tracks: Tracks, start: Geometry, solve: Solve) -> Adjusted:
        """Adjust the geometry and the features of `tracks` from `start`.

        `solve` answers what the graph makes of the quadratic at a geometry. It hears the sightings
        as if they erred independently; what is returned is made less sure for errors that are
        correlated along tracks, or shared by a projection (`crowding`). Where it finds no answer,
        NaN, the geometry stays as it is.
        """
        if tracks.n_sightings == 0:
            return nothing_seen(start)
        # Grown tracks might depend on the last digit of sums.
        with on_one_thread():
            return self._settled(tracks, start, solve)

    def _settled(self, tracks: Tracks, start: Geometry, solve: Solve) -> Adjusted:
        """Take Gauss-Newton steps until the angles settle, see `adjust`."""
        sightings = Sightings.of(tracks, start.theta)
        weighing = Weighing.of(self, sightings, start)
        position, weights = placed(sightings, start, weighing)
        geometry = start
        for _ in range(self.rounds):
            weights = weighing.weights(sightings.residuals(geometry, position), weights)
            change, moves = self._step(sightings, geometry, (position, weights), solve)
            if not np.isfinite(change).all():
                break
            geometry, position = geometry.moved(change), position + moves
            if np.abs(change[geometry.layout.angles]).max() < np.deg2rad(self.settled_deg):
                break
        return self._adjusted(sightings, geometry, position, weights)

    def _step(
        self,
        sightings: Sightings,
        geometry: Geometry,
        placed: tuple[Floats, Floats],
        solve: Solve,
    ) -> tuple[Floats, Floats]:
        """(k,) the change of the geometry, and (f, 2) px how features move along with it."""
        step = eliminated(sightings, geometry, *placed)
        hear_rows(step.quadratic, sightings, geometry, self)
        change = solve(geometry, step.quadratic)
        return change, step.moves(change)

    def _adjusted(
        self, sightings: Sightings, geometry: Geometry, position: Floats, weights: Floats
    ) -> Adjusted:
        residuals = sightings.residuals(geometry, position)
        scale = robust_scale(residuals)
        inflation = correlation(sightings, residuals * np.sqrt(weights), self.correlated)
        in_order = np.argsort(sightings.order)

        def quadratic() -> Quadratic:
            sure = weights / inflation
            sure /= crowding(sightings, geometry, position, sure)[sightings.projection]
            said = eliminated(sightings, geometry, position, sure).quadratic
            hear_rows(said, sightings, geometry, self, inflation)
            return said

        return Adjusted(
            geometry=geometry,
            quadratic=quadratic,
            features=sightings.features(geometry, position, (weights, scale)),
            residuals=residuals[in_order],
            weights=weights[in_order],
            scale=scale,
            inflation=inflation,
        )


def placed(sightings: Sightings, geometry: Geometry, weighing: Weighing) -> tuple[Floats, Floats]:
    """(f, 2) px: features for a given geometry, and the weights (s,) that they were placed with."""
    position = sightings.positions(geometry, np.ones(len(sightings.feature)))
    weights = weighing.weights(sightings.residuals(geometry, position))
    position = sightings.positions(geometry, weights)
    for _ in range(FIRST_ROUNDS - 1):
        weights = weighing.weights(sightings.residuals(geometry, position), weights)
        position = sightings.positions(geometry, weights)
    return position, weights


def nothing_seen(geometry: Geometry) -> Adjusted:
    """Return what no sightings say: nothing about `geometry`."""
    size = geometry.layout.size
    none = np.empty(0)
    features = Features(np.empty((0, 2)), np.empty((0, 2, 2)), none, none, 0.0)

    def silent() -> Quadratic:
        return Quadratic(np.zeros((size, size)), np.zeros(size))

    return Adjusted(geometry, silent, features, none, none, scale=0.0, inflation=1.0)


def correlation(sightings: Sightings, whitened: Floats, most: int) -> float:
    """By how much errors correlated along tracks inflate the variance: 1 where there are none.

    The integrated autocorrelation of `whitened` (s,) residuals, up to `most` sightings apart.
    """
    z = np.clip(whitened, -3, 3)
    power = float(np.mean(z**2))
    total = 1.0
    for lag in range(1, most + 1 if power > 0 else 1):
        same = sightings.feature[lag:] == sightings.feature[:-lag]
        along = float(np.mean((z[lag:] * z[:-lag])[same])) / power if same.any() else 0.0
        if along < 0.05:
            break
        total += 2 * along
    return total
