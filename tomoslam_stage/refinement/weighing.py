"""Robust weights of sightings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tomoslam_stage.images import robust_scale
from tomoslam_stage.refinement.quality import predicted_sigma, signs

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Geometry
    from tomoslam_stage.refinement.sightings import Sightings


class Strictness(Protocol):
    """How strictly sightings are weighed, see `Landmarks`."""

    @property
    def grip(self) -> float:
        """Standard deviations at which a sighting has lost three quarters of its weight."""
        ...

    @property
    def floor(self) -> float:
        """px: no sighting is better than this."""
        ...

    @property
    def common(self) -> float:
        """Sightings' worth of belief that a track is no better and no worse than others."""
        ...


@dataclass(frozen=True)
class Weighing:
    """Turns residuals into weights, sighting by sighting."""

    strictness: Strictness
    """How strict."""
    sightings: Sightings
    """What is weighed."""
    signs: Floats
    """(s, c) see `quality`."""
    directions: Floats
    """(s, 2) cosine and sine of the angles."""

    @classmethod
    def of(cls, strictness: Strictness, sightings: Sightings, geometry: Geometry) -> Weighing:
        """Look at the sightings once; their signs hardly depend on small changes of the angles."""
        looks = signs(sightings, geometry.theta)
        return cls(strictness, sightings, looks, sightings.directions(geometry))

    def weights(self, residuals: Floats, before: Floats | None = None) -> Floats:
        """(s,) px^-2: Geman-McClure weights of `residuals` (s,) px, after the weights `before`."""
        if before is None:
            common = max(robust_scale(residuals), self.strictness.floor)
            before = geman_mcclure(residuals, common, self.strictness.grip)
        sigma = predicted_sigma(
            self.signs, residuals, self._leverage(before), self.strictness.floor
        )
        sigma = sigma * self._of_track(residuals / sigma)
        return geman_mcclure(residuals, sigma, self.strictness.grip)

    def _leverage(self, weights: Floats) -> Floats:
        """(s,) how far a feature follows each of its sightings."""
        covariance = self.sightings.covariances(self.directions, weights)
        a = self.directions
        along = np.einsum("si,sij,sj->s", a, covariance[self.sightings.feature], a)
        return np.asarray(weights * along)

    def _of_track(self, whitened: Floats) -> Floats:
        """(s,) how much worse a track is than its looks, from its `whitened` (s,) residuals."""
        belief, counts = self.strictness.common, self.sightings.counts
        squares = self.sightings.sums(np.minimum(whitened**2, 9.0))
        excess = np.clip((squares + belief) / (counts + belief), 0.5, 4.0)
        return np.asarray(np.sqrt(excess)[self.sightings.feature])


def geman_mcclure(residuals: Floats, sigma: Floats | float, grip: float) -> Floats:
    """(s,) px^-2: weights that fall to a quarter at `grip` standard deviations `sigma`, px."""
    relative = residuals / (grip * sigma)
    return np.asarray(1 / (1 + relative**2) ** 2 / sigma**2)
