"""What every detector returns, and the Protocol that makes something a detector."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products import Floats, Integers, Pixels

Descriptors: TypeAlias = NDArray[np.float16]


@dataclass(frozen=True)
class Keypoints:
    """The keypoints of one projection, the strongest first."""

    column: Floats
    """(k,) px."""
    row: Floats
    """(k,) px."""
    size: Floats
    """(k,) px: standard deviation of the Gaussian (or its like) at which it was found."""
    descriptor: Descriptors
    """(k, d) of unit length; half precision, as a long scan has millions."""

    def __len__(self) -> int:
        return len(self.column)

    def chosen(self, which: NDArray[np.bool_] | Integers) -> Keypoints:
        """Return the keypoints where a mask (k,) holds, or those with the given numbers."""
        return Keypoints(
            self.column[which], self.row[which], self.size[which], self.descriptor[which]
        )


@runtime_checkable
class Detector(Protocol):
    """Finds keypoints in one projection; upright, since the object never turns in the plane."""

    def detect(self, image: Pixels, noise: float) -> Keypoints:
        """Keypoints of `image` (row, column), whose values lie between 0 and 1.

        `noise` is the standard deviation of the white noise in `image`.
        """
        ...

    def at_most(self, keypoints: int) -> Detector:
        """Return the same, but with so many keypoints, the strongest, in a projection at most."""
        ...

    def mirrored(self, descriptors: Pixels) -> Pixels:
        """(k, d) descriptors of the patches that `descriptors` (k, d) see, in the mirror.

        Half a turn on, a projection is its own mirror image, columns reversed.
        """
        ...
