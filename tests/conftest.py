"""What tests of several rooms look at: an object whose projections are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from tomoslam_stage.products import Floats, Pixels


@dataclass(frozen=True)
class Blobs:
    """Round Gaussian blobs in a few slices, at the same places but of other heights in each."""

    x: Floats
    """(b,) px from the axis."""
    z: Floats
    """(b,) px from the axis."""
    width: Floats
    """(b,) px: standard deviation."""
    height: Floats
    """(r, b) attenuation per px."""

    def slices(self, size: int) -> Pixels:
        """(r, z, x) attenuation per px, the axis in the middle."""
        along = np.arange(size) - (size - 1) / 2
        squared = (along - self.x[:, None, None]) ** 2 + (
            along[:, None] - self.z[:, None, None]
        ) ** 2
        shapes = np.exp(-squared / (2 * self.width[:, None, None] ** 2))
        return np.einsum("rb,bzx->rzx", self.height, shapes).astype(np.float32)

    def sinograms(self, theta: Floats, axis: float, columns: int) -> Pixels:
        """(r, n, column) line integrals."""
        _, shadows = self._shadows(theta, axis, columns)
        return np.einsum("rb,bnc->rnc", self.height, shadows).astype(np.float32)

    def derivative(self, theta: Floats, axis: float, columns: int) -> Pixels:
        """(r, n, column) derivative of the line integrals by the angle, per radian."""
        off, shadows = self._shadows(theta, axis, columns)
        speed = np.outer(self.z, np.cos(theta)) - np.outer(self.x, np.sin(theta))
        slope = shadows * off / self.width[:, None, None] ** 2 * speed[..., None]
        return np.einsum("rb,bnc->rnc", self.height, slope).astype(np.float32)

    def _shadows(self, theta: Floats, axis: float, columns: int) -> tuple[Floats, Floats]:
        """(b, n, column) px from the middle of each blob, and the blob's shadow."""
        middle = np.outer(self.x, np.cos(theta)) + np.outer(self.z, np.sin(theta))
        off = np.arange(columns) - axis - middle[..., None]
        width = self.width[:, None, None]
        return off, width * np.sqrt(2 * np.pi) * np.exp(-(off**2) / (2 * width**2))


@pytest.fixture(scope="session")
def blobs() -> Blobs:
    """Three slices of three blobs without any symmetry, all within 20 px of the axis."""
    return Blobs(
        x=np.array([10.0, -7.0, 13.0]),
        z=np.array([-4.0, 9.0, 12.0]),
        width=np.array([2.0, 3.0, 1.5]),
        height=np.array([[1.0, 0.5, 0.8], [0.2, 0.9, 0.0], [0.0, 0.1, 1.2]]),
    )


@pytest.fixture(scope="session")
def dots() -> Blobs:
    """Two slices of sixty small blobs within 36 px of the axis: texture everywhere."""
    rng = np.random.default_rng(12)
    radius, angle = 36 * np.sqrt(rng.random(60)), rng.uniform(0, 2 * np.pi, 60)
    return Blobs(
        x=radius * np.cos(angle),
        z=radius * np.sin(angle),
        width=rng.uniform(1.0, 2.5, 60),
        height=rng.uniform(0.02, 0.1, (2, 60)),
    )
