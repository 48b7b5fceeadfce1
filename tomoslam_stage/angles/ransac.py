"""RANSAC over pairs of tracks with the paper's test of consistency (its section 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import triangle_angles
from tomoslam_stage.methods import method

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Integers


@method
class Ransac:
    """Finds the tracks of a triplet that agree on k, whatever the others do."""

    probability: Annotated[float, Field(gt=0, lt=1)] = 0.999
    """Wanted probability p that at least one pair of tracks is reliable."""
    reliable: Annotated[float, Field(gt=0, lt=1)] = 0.4
    """Share q of the tracks that are reliable."""
    k_tolerance: Annotated[float, Field(gt=0)] = 0.15
    """Largest difference of k between a pair and a track that agrees with it."""

    @property
    def trials(self) -> int:
        """Pairs to be drawn: ``log(1 - p) / log(1 - q^2)``.

        The paper prints ``(1 - p) / (1 - q^2)``, which is less than one.
        """
        return int(np.ceil(np.log1p(-self.probability) / np.log1p(-(self.reliable**2))))

    def consensus(self, columns: Floats, seed: int) -> tuple[Integers, NDArray[np.bool_]]:
        """(2,) the pair of tracks that most others agree with, and (t,) which do.

        Parameters
        ----------
        columns
            (t, 3) px from the axis: each track's columns in the three projections.
        seed
            Of the random pairs.
        """
        count = len(columns)
        generator = np.random.default_rng(seed)
        first = generator.integers(count, size=self.trials)
        second = (first + generator.integers(1, count, size=self.trials)) % count
        k = k_of_pairs(columns[first], columns[second])
        agrees = self._near(k, columns[first], columns) & self._near(k, columns[second], columns)
        # A track says nothing about k in a pair with itself.
        trial = np.arange(self.trials)
        agrees[trial, first] = agrees[trial, second] = np.isfinite(k)
        best = np.argmax(agrees.sum(axis=1))
        return np.array([first[best], second[best]]), agrees[best]

    def _near(self, k: Floats, one: Floats, columns: Floats) -> NDArray[np.bool_]:
        """(trials, t) whether each track, paired with `one` of the drawn pair, gives the same k."""
        other = k_of_pairs(one[:, None], columns[None])
        with np.errstate(invalid="ignore"):
            return np.asarray((other - k[:, None]) ** 2 < self.k_tolerance**2)


def k_of_pairs(one: Floats, other: Floats) -> Floats:
    """``k = sin(D1 + D2) / sin(D1)`` from two tracks (..., 3), px from the axis.

    ``k = (x3 x~1 - x1 x~3) / (x2 x~1 - x1 x~2)``: the paper's equation 2, where the subscript 0 is
    a misprint of 1. NaN where both tracks lie on one line through the axis.
    """
    numerator = one[..., 2] * other[..., 0] - one[..., 0] * other[..., 2]
    denominator = one[..., 1] * other[..., 0] - one[..., 0] * other[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(np.abs(denominator) > 1e-9, numerator / denominator, np.nan))


def steps_of_pair(one: Floats, other: Floats) -> Floats:
    """(..., 2) radians: both steps from a single pair of tracks (..., 3): the paper's equation 2.

    The minimal sample. With k from the pair, ``m = (k x2 - x3) / x1`` (here over both tracks in
    the least squares sense, as x1 may vanish), and the cosine rule gives
    ``cos(D1) = (m^2 + k^2 - 1) / (2 m k)``, which is the paper's
    ``((1 - k^2) x1^2 - (x3 - k x2)^2) / (2 k x1 (x3 - k x2))`` in other letters.
    """
    k = k_of_pairs(one, other)
    both = np.stack([one, other], axis=-1)
    x1, x2, x3 = np.moveaxis(both, -2, 0)
    m = ((k[..., None] * x2 - x3) * x1).sum(-1) / (x1**2).sum(-1)
    return triangle_angles(np.stack([m, -k, np.ones_like(k)], axis=-1))
