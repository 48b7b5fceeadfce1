"""Features that are one: found at one place of the object, on one row, at one size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method

if TYPE_CHECKING:
    from tomoslam_stage.products import Features, Floats, Integers


@dataclass(frozen=True)
class Candidates:
    """Features and how large they look."""

    features: Features
    """Where they lie."""
    size: Floats
    """(f,) mean logarithm of the sizes of their keypoints, px."""


@method
class Merging:
    """Joins pairs of features that the sightings cannot tell apart."""

    near: Annotated[float, Field(gt=0)] = 1.0
    """px: places closer than this are one, however sure they are."""
    sigmas: Annotated[float, Field(gt=0)] = 3.0
    """Largest distance of the places of one feature, in standard deviations."""
    row_tolerance: Annotated[float, Field(gt=0)] = 1.0
    """Largest difference of rows, px."""
    size_ratio: Annotated[float, Field(gt=1)] = 1.4
    """Largest ratio of the sizes."""
    least_sure: Annotated[float, Field(gt=0)] = 2.0
    """px: features whose place is less sure than this are left alone."""

    def merged(self, candidates: Candidates, inflation: float) -> Integers:
        """(f,) the feature that each becomes: itself, or a better supported one at its place.

        The nearest go first, and no feature is joined twice. Standard deviations are multiplied by
        `inflation`.
        """
        pairs, apart = self._pairs(candidates, inflation)
        becomes = np.arange(len(candidates.features))
        support = candidates.features.support
        used = np.zeros(len(becomes), bool)
        for one, other in pairs[np.argsort(apart, kind="stable")].tolist():
            if not (used[one] or used[other]):
                used[one] = used[other] = True
                kept, gone = (one, other) if support[one] >= support[other] else (other, one)
                becomes[gone] = kept
        return becomes

    def _pairs(self, candidates: Candidates, inflation: float) -> tuple[Integers, Floats]:
        """(p, 2) features that may be one, and (p,) the squared distance in standard deviations."""
        from scipy.spatial import cKDTree

        features, size = candidates.features, candidates.size
        covariance = features.covariance * inflation**2
        sure = np.flatnonzero(np.trace(covariance, axis1=1, axis2=2) < self.least_sure**2)
        if len(sure) < 2:
            return np.empty((0, 2), np.intp), np.empty(0)
        reach = 2 * self.sigmas * self.row_tolerance
        # Rows are stretched, so that the same reach is half as wide along them.
        place = np.column_stack([features.position, self.sigmas * features.row])[sure]
        one, other = sure[cKDTree(place).query_pairs(reach, output_type="ndarray")].T
        alike = np.abs(features.row[one] - features.row[other]) < self.row_tolerance
        alike &= np.abs(size[one] - size[other]) < np.log(self.size_ratio)
        one, other = one[alike], other[alike]
        between = features.position[one] - features.position[other]
        floor = (self.near / self.sigmas) ** 2 * np.eye(2)
        either = np.linalg.inv(covariance[one] + covariance[other] + floor)
        apart = np.einsum("pi,pij,pj->p", between, either, between)
        near = apart < self.sigmas**2
        return np.stack([one, other], axis=1)[near], apart[near]
