"""Linear factors on the angles, all of one kind, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import AngleMeasurements, Floats, Integers


@dataclass(frozen=True)
class Block:
    """Factors ``|| R (J theta - measured) ||^2``, each on the same number of angles."""

    projections: Integers
    """(f, k) the angles that each factor joins."""
    jacobian: Floats
    """(d, k) the same for all factors of the block, or (f, d, k)."""
    measured: Floats
    """(f, d) radians."""
    whitening: Floats
    """(f, d, d) R, an inverse square root of each covariance, per radian."""
    robust: float = np.inf
    """Residual, in standard deviations, beyond which a factor loses its grip (Cauchy)."""

    def residuals(self, theta: Floats) -> Floats:
        """(f, d) radians: what the factors still want to change at `theta` (n,)."""
        expected = self.jacobian @ theta[self.projections][..., None]
        return np.asarray(expected[..., 0] - self.measured)

    def distance(self, theta: Floats) -> Floats:
        """(f,) length of the whitened residuals for each dimension: about 1 when all is well."""
        white = np.einsum("fij,fj->fi", self.whitening, self.residuals(theta))
        return np.asarray(np.sqrt(np.mean(white**2, axis=1)))

    def weights(self, theta: Floats) -> Floats:
        """(f,) weight of each factor under its robust noise model."""
        return np.asarray(1 / (1 + (self.distance(theta) / self.robust) ** 2))


@runtime_checkable
class Factor(Protocol):
    """Makes the factors of one kind from what is known about the scan."""

    def block(self, theta: Floats, measurements: AngleMeasurements) -> Block:
        """Return the factors on the recorded angles `theta` (n,) and the `measurements`."""
        ...
