"""What can be asked of a backend: the algorithms and their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from tomoslam_stage.images import Window
from tomoslam_stage.methods import method


@method
class Fbp:
    """Filtered back-projection; each projection weighs as much as the angle it stands for."""

    window: Window = "shepp-logan"
    """Apodisation of the ramp: from the sharpest, ``ram-lak`` (none), through ``shepp-logan``,
    ``cosine``, ``hamming`` and ``hann`` to the smoothest, ``parzen``."""


@method
class Gridrec:
    """Fourier regridding (Marone and Stampanoni, J. Synchrotron Rad. 19 (2012) 1029).

    Faster than filtered back-projection, and as accurate where it is padded; tomopy has it.
    """

    window: Window = "shepp-logan"
    """Apodisation of the ramp, as in `Fbp`."""


@method
class Sirt:
    """Simultaneous iterative reconstruction (Gilbert, J. Theor. Biol. 36 (1972) 105).

    Take it for few or noisy projections, or a wedge that is missing; it takes many times longer.
    """

    iterations: Annotated[int, Field(ge=1)] = 100
    """Times that all projections are used."""
    nonnegative: bool = True
    """Attenuation below zero is set to zero in every iteration."""


@method
class Iterative:
    """Any other iterative algorithm of tomopy, by the name it has there."""

    name: Literal[
        "art",
        "bart",
        "mlem",
        "osem",
        "ospml_hybrid",
        "ospml_quad",
        "pml_hybrid",
        "pml_quad",
        "tv",
        "grad",
        "tikh",
    ] = "mlem"
    """See tomopy's documentation of ``recon``."""
    iterations: Annotated[int, Field(ge=1)] = 50
    """Times that all projections are used."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What else tomopy takes for it, as ``reg_par`` or ``num_block``."""


Algorithm: TypeAlias = Fbp | Gridrec | Sirt | Iterative

ALGORITHMS: Mapping[str, type[Algorithm]] = {
    "fbp": Fbp,
    "gridrec": Gridrec,
    "sirt": Sirt,
    "iterative": Iterative,
}
"""By the name they have in a pipeline."""
