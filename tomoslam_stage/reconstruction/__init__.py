"""Sinograms and angles -> slices, by one of several backends.

To add an algorithm, write its parameters in ``algorithms.py``; to add a backend, write
``with_NAME.py`` and name it in `BACKENDS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from tomoslam_stage.errors import BackendMissingError
from tomoslam_stage.reconstruction.algorithms import (
    ALGORITHMS,
    Algorithm,
    Fbp,
    Gridrec,
    Iterative,
    Sirt,
)
from tomoslam_stage.reconstruction.backend import Backend, Slices
from tomoslam_stage.reconstruction.with_finufft import Embedded
from tomoslam_stage.reconstruction.with_tomopy import Tomopy

if TYPE_CHECKING:
    from collections.abc import Mapping

BACKENDS: Mapping[str, Backend] = {"tomopy": Tomopy(), "embedded": Embedded()}
"""By the name they have in a pipeline; ``auto`` takes the first that does not refuse."""

BackendName: TypeAlias = Literal["auto", "tomopy", "embedded"]

__all__ = [
    "ALGORITHMS",
    "BACKENDS",
    "Algorithm",
    "Backend",
    "BackendName",
    "Fbp",
    "Gridrec",
    "Iterative",
    "Sirt",
    "Slices",
    "choose_backend",
]


def choose_backend(name: BackendName, algorithm: Algorithm) -> Backend:
    """Return the backend of that name, or of ``auto`` the first that can do `algorithm`.

    Raises
    ------
    BackendMissingError
        If it is not installed or cannot do just that; the message says why, and what can.
    """
    asked = list(BACKENDS) if name == "auto" else [name]
    refusals = {}
    for known in asked:
        why = BACKENDS[known].refusal(algorithm)
        if not why:
            return BACKENDS[known]
        refusals[known] = why
    found = "; ".join(f"{known} {why}" for known, why in refusals.items())
    raise BackendMissingError("reconstruct.backend", f"{found}.", "Choose another algorithm.")
