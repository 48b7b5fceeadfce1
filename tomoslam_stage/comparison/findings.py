"""What a run found, and the few numbers that pictures, report and summary all tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tomoslam_stage.comparison.regions import rms
from tomoslam_stage.products import (
    Comparison,
    Integers,
    Reconstructions,
    Refinement,
    Scan,
    Truth,
)


@dataclass(frozen=True)
class Findings:
    """All that the pictures and the report tell about."""

    scan: Scan
    """Asked for its name and shape only; no projection is read."""
    refinement: Refinement
    """The angles and the verdict."""
    reconstructions: Reconstructions
    """``recorded``, ``refined``, perhaps ``true`` and halves; empty where none were made."""
    comparison: Comparison
    """The numbers of `compare`."""
    truth: Truth | None = None
    """Drawn beside the correction, where the scan is simulated."""


@dataclass(frozen=True)
class Run:
    """How the findings came about."""

    seconds: Mapping[str, float] = field(default_factory=dict)
    """Station -> s it took."""
    pipeline: Sequence[Mapping[str, Any]] = ()
    """The entries as they ran, all parameters included."""


@dataclass(frozen=True)
class ResidualChange:
    """How well the rows reproject, over all projections that have both residuals."""

    recorded: float
    """Line integral units, rms."""
    refined: float
    """Line integral units, rms."""

    @property
    def percent(self) -> float:
        """Change of the residual in percent; negative is better."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(100 * (np.divide(self.refined, self.recorded) - 1))


def residual_change(refinement: Refinement) -> ResidualChange:
    """Compare the residuals of recorded and refined angles; nan where one is missing."""
    nothing = np.empty(0)
    pair = [refinement.reprojection.get(name, nothing) for name in ("recorded", "refined")]
    if len(pair[0]) != len(pair[1]):
        pair = [nothing, nothing]
    both = np.isfinite(pair[0]) & np.isfinite(pair[1])
    return ResidualChange(rms(pair[0][both]), rms(pair[1][both]))


def rows_word(heldout_rows: Integers) -> str:
    """Say which rows the residual speaks about."""
    return "unused rows" if len(heldout_rows) else "the rows used"


def verdict(findings: Findings) -> str:
    """Say which angles stand and, where they are new, how much better the rows reproject."""
    refinement = findings.refinement
    if refinement.status == "kept":
        return "recorded angles kept; the refined angles are not used"
    percent = residual_change(refinement).percent
    if not np.isfinite(percent):
        return "refined angles accepted"
    where = rows_word(refinement.heldout_rows)
    return f"refined angles accepted: reprojection residual on {where} {signed(percent)} %"


def gauge(refinement: Refinement) -> str:
    """Say what no scan tells about its angles, and how it was settled; empty where none moved."""
    if not np.isfinite(refinement.sigma).any():
        return ""
    text = "the first angle is held where it was recorded; a common angle of all and the mirror "
    text += "image cannot be seen; "
    if "used" in refinement.sources.values():
        text += "the common angle was taken out of sigma; axis and roll were solved together with "
        return f"{text}the angles"
    return f"{text}sigma is counted from the first angle; the axis was looked for by itself"


def signed(value: float) -> str:
    """Write a change with one decimal and a sign that is not a hyphen."""
    return f"{value:+.1f}".replace("-", "−")


def row_label(row: int, binning: int) -> str:
    """Name a row of the scan by the row or rows of the file it was made of."""
    if binning == 1:
        return f"detector row {row}"
    return f"detector rows {row * binning} to {row * binning + binning - 1}"
