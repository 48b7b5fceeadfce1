"""The Protocol that makes something a reconstruction backend."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels


@runtime_checkable
class Algorithm(Protocol):
    """Reconstructs slices from sinograms."""

    def slices(self, sinograms: Pixels, theta: Floats, axis: float) -> Pixels:
        """Slices (r, z, x), attenuation per pixel, as wide as the detector.

        Parameters
        ----------
        sinograms
            (r, n, column) line integrals.
        theta
            (n,) radians.
        axis
            Detector column of the rotation axis, px.
        """
        ...
