"""How the sample moved on its stage: the shift of every projection, as curves show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.geometry import unseen_shifts

if TYPE_CHECKING:
    from tomoslam_stage.comparison.findings import Findings
    from tomoslam_stage.products import Floats


@dataclass(frozen=True)
class Shifts:
    """Shifts in px of the file, to the right."""

    found: Floats
    """(n,)"""
    sigma: Floats
    """(n,) one standard deviation; NaN where it is not known."""
    true: Floats | None
    """(n,) but for what nobody sees of them, where the scan is simulated."""


def shifts_of(findings: Findings) -> Shifts | None:
    """Return the shifts that were found; None where the sample was taken to stand still."""
    refinement, binning = findings.refinement, findings.scan.binning
    if refinement.shift is None:
        return None
    found, sigma = binning * refinement.shift, refinement.shift_sigma
    unknown = np.full_like(found, np.nan)
    true = None if findings.truth is None else findings.truth.shift
    if true is not None:
        unseen = unseen_shifts(refinement.refined)
        true = true + unseen @ (unseen.T @ (found - true))
    return Shifts(found, unknown if sigma is None else binning * sigma, true)
