"""The Protocol that makes something a reconstruction backend."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels
    from tomoslam_stage.reconstruction.algorithms import Algorithm


@dataclass(frozen=True)
class Slices:
    """What a backend made of some sinograms."""

    slices: Pixels
    """(r, z, x) attenuation per pixel, as wide as the detector."""
    convergence: Floats = field(default_factory=lambda: np.empty(0))
    """(iterations,) rms of what is left of the sinograms before each; empty where none iterate."""


class Backend(Protocol):
    """Reconstructs slices from sinograms."""

    name: ClassVar[str]
    """What pipelines and reports call it."""

    def refusal(self, algorithm: Algorithm) -> str:
        """Why it cannot do just this here; empty where it can."""
        ...

    def reconstruct(
        self, algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float
    ) -> Slices:
        """Reconstruct slices; their middle ``(n - 1) / 2`` lies on the axis.

        Parameters
        ----------
        algorithm
            One that is not refused.
        sinograms
            (r, n, column) line integrals.
        theta
            (n,) radians.
        axis
            Detector column of the rotation axis, px.
        """
        ...
