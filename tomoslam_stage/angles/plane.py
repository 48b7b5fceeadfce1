"""The plane that all features of a triplet span, by total least squares.

The columns ``(x1, x2, x3)`` of a feature in three projections obey ``m x1 - k x2 + x3 = c``: a
plane whose normal ``(m, -k, 1)`` holds both steps (`geometry.triangle_angles`) and whose offset
holds the axis. All three columns carry the same noise, so the plane is fitted by total least
squares; ordinary least squares of x3 on x1, x2 is biased towards smaller k, that is towards larger
steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import triangle_angles, triangle_jacobian
from tomoslam_stage.images import robust_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats


@dataclass(frozen=True)
class Plane:
    """A fitted plane."""

    normal: Floats
    """(3,) of unit length, its last element positive."""
    offset: float
    """Distance from the origin along the normal, px."""
    scatter: float
    """Standard deviation of the columns about the plane, px."""
    covariance: Floats
    """(3, 3) of the normal."""

    def residuals(self, columns: Floats) -> Floats:
        """(t,) px: distance of `columns` (t, 3) from the plane."""
        return np.asarray(columns @ self.normal - self.offset)

    def steps(self) -> tuple[Floats, Floats]:
        """(2,) radians, both steps without their sign, and their (2, 2) covariance: closed form."""
        steps = triangle_angles(self.normal[None])
        jacobian = triangle_jacobian(self.normal[None], steps)[0]
        return steps[0], jacobian @ self.covariance @ jacobian.T

    def steps_near(self, expected: Floats) -> tuple[Floats, Floats]:
        """(2,) radians, both steps without their sign, and their (2, 2) covariance: linearised.

        The normal is compared with that of the `expected` (2,) steps, in the plane that touches the
        unit sphere there. There is no cosine that noise could push out of its range, so no triplet
        is lost for that; the sum of the steps is measured even where the features, all in one
        sheet, leave their difference open.
        """
        normal, jacobian = normal_of(expected)
        touching = np.linalg.svd(normal[None])[2][1:]
        to_steps = np.linalg.inv(touching @ jacobian) @ touching
        ours = self.normal if self.normal @ normal > 0 else -self.normal
        steps = expected + to_steps @ (ours - normal)
        return steps, to_steps @ self.covariance @ to_steps.T

    @property
    def alternates(self) -> bool:
        """Whether the signs of the normal are those of two steps less than a half turn."""
        return bool(self.normal[0] > 0 > self.normal[1])


def normal_of(steps: Floats) -> tuple[Floats, Floats]:
    """(3,) the plane's unit normal for two `steps` (2,) in radians, and its (3, 2) derivative.

    Along ``(sin(D2), -sin(D1 + D2), sin(D1))``, which is ``(m, -k, 1)`` times sin(D1).
    """
    first, second = steps
    both = first + second
    along = np.array([np.sin(second), -np.sin(both), np.sin(first)])
    derivative = np.array([[0, np.cos(second)], [-np.cos(both), -np.cos(both)], [np.cos(first), 0]])
    length = np.linalg.norm(along)
    normal = along / length
    return normal, (derivative - np.outer(normal, normal @ derivative)) / length


def fit_plane(columns: Floats) -> Plane:
    """Fit a plane to `columns` (t, 3) by total least squares, t at least 4.

    The normal is the eigenvector of the columns' covariance that belongs to the smallest
    eigenvalue; its covariance follows from first-order perturbation of the eigenvectors.
    """
    count = len(columns)
    mean = columns.mean(axis=0)
    centred = columns - mean
    values, vectors = np.linalg.eigh(centred.T @ centred / count)
    normal = vectors[:, 0] * (1 if vectors[2, 0] >= 0 else -1)
    # Rounding may leave a tiny negative eigenvalue where the columns have no error.
    variance = max(values[0], 0.0) * count / max(count - 3, 1)
    gaps = np.maximum(values[1:] - values[0], 1e-12)
    spread = vectors[:, 1:] * (variance * values[1:] / gaps**2 / count)
    return Plane(normal, float(mean @ normal), float(np.sqrt(variance)), spread @ vectors[:, 1:].T)


def fit_robustly(columns: Floats, inliers: NDArray[np.bool_]) -> tuple[Plane, NDArray[np.bool_]]:
    """Fit a plane to the `inliers` (t,), then choose them anew by their distance, until they stay.

    What lies within three robust standard deviations of the plane is an inlier; at most ten times.
    """
    plane = fit_plane(columns[inliers])
    for _ in range(10):
        distance = np.abs(plane.residuals(columns))
        limit = max(3 * robust_scale(distance[inliers]), 1e-3)
        chosen = distance <= limit
        if chosen.sum() < 4 or np.array_equal(chosen, inliers):
            break
        inliers = chosen
        plane = fit_plane(columns[inliers])
    return plane, inliers
