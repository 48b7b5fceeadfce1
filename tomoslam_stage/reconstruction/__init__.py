"""Sinograms and angles -> Reconstructions.

To add a backend, write ``with_NAME.py`` and name its algorithms in `ALGORITHMS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage.reconstruction.backend import Algorithm
from tomoslam_stage.reconstruction.with_finufft import Fbp, Sirt

if TYPE_CHECKING:
    from collections.abc import Mapping

ALGORITHMS: Mapping[str, type[Algorithm]] = {"fbp": Fbp, "sirt": Sirt}

__all__ = ["ALGORITHMS", "Algorithm", "Fbp", "Sirt"]
