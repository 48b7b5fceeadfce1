"""The algorithms of tomopy, where it is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tomoslam_stage import tomopy_adapter
from tomoslam_stage.radon import continued, reach_beyond
from tomoslam_stage.reconstruction.algorithms import Fbp, Gridrec, Iterative, Sirt
from tomoslam_stage.reconstruction.backend import Slices

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels
    from tomoslam_stage.reconstruction.algorithms import Algorithm


class Tomopy:
    """Reconstructs with tomopy (Gursoy et al., J. Synchrotron Rad. 21 (2014) 1188).

    It does not tell how its SIRT converges.
    """

    name: ClassVar[str] = "tomopy"

    def refusal(self, algorithm: Algorithm) -> str:  # noqa: ARG002 - it has them all
        """Why it cannot do just this here; empty where it can."""
        if tomopy_adapter.version() is None:
            return f"is not installed ({tomopy_adapter.HOW_TO_GET_IT})"
        return ""

    def reconstruct(
        self, algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float
    ) -> Slices:
        """Reconstruct slices, see `Backend.reconstruct`.

        Where the object is wider than the detector, from the sinograms as `continued`.
        """
        beyond = reach_beyond(sinograms)
        wide = reconstructed(algorithm, continued(sinograms, beyond), theta, axis + beyond)
        seen = slice(beyond, beyond + sinograms.shape[-1])
        return Slices(np.ascontiguousarray(wide[:, seen, seen]))


def reconstructed(algorithm: Algorithm, sinograms: Pixels, theta: Floats, axis: float) -> Pixels:
    """Slices (r, z, x) as wide as `sinograms`."""
    match algorithm:
        case Fbp():
            return tomopy_adapter.fbp(sinograms, theta, axis, algorithm.window)
        case Gridrec():
            return tomopy_adapter.gridrec(sinograms, theta, axis, algorithm.window)
        case Sirt():
            times, nonnegative = algorithm.iterations, algorithm.nonnegative
            return tomopy_adapter.sirt(sinograms, theta, axis, times, nonnegative)
        case Iterative():
            options = {"num_iter": algorithm.iterations, **algorithm.options}
            return tomopy_adapter.iterate(sinograms, theta, axis, algorithm.name, options)
