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
    Tracks,
    Truth,
)


@dataclass(frozen=True)
class Findings:
    """All that the pictures and the report tell about."""

    scan: Scan
    """The page shows some projections and one row of it, read one by one; all else asks for its
    name and shape only."""
    refinement: Refinement
    """The angles and the verdict."""
    reconstructions: Reconstructions
    """``recorded``, ``refined``, perhaps ``true`` and halves; empty where none were made."""
    comparison: Comparison
    """The numbers of `compare`."""
    truth: Truth | None = None
    """Drawn beside the correction, where the scan is simulated."""
    tracks: Tracks | None = None
    """Drawn over the projections, where features were followed; px of `scan`."""


@dataclass(frozen=True)
class Run:
    """How the findings came about."""

    seconds: Mapping[str, float] = field(default_factory=dict)
    """Station -> s it took."""
    pipeline: Sequence[Mapping[str, Any]] = ()
    """The entries as they ran, all parameters included."""
    started: str = ""
    """ISO 8601."""


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
        return f"{text}the common angle was taken out of sigma; {solved_together(refinement)}"
    return f"{text}sigma is counted from the first angle; the axis was looked for by itself"


def median_sigma_deg(refinement: Refinement) -> float:
    """Median of the sigma that are known, degrees; nan where none is."""
    known = refinement.sigma[np.isfinite(refinement.sigma)]
    return float(np.degrees(np.median(known))) if len(known) else float("nan")


def solved_together(refinement: Refinement) -> str:
    """Say what beside the angles was solved for, and what of the shifts nobody sees."""
    unknowns = refinement.unknowns
    solved = ", ".join(name for name in unknowns if name != "theta")
    held = ", ".join(name for name in ("axis", "roll") if name not in unknowns)
    said = [f"solved together with the angles: {solved or 'nothing'}"]
    if held:
        said.append(f"held: {held}")
    if "shift" in unknowns:
        said.append(
            "a shift of all projections is the axis, and one that goes round with the turn a place "
            "of the sample: of these the smallest shifts were taken"
        )
    return "; ".join(said)


def signed(value: float) -> str:
    """Write a change with one decimal and a sign that is not a hyphen."""
    return f"{value:+.1f}".replace("-", "−")


def row_label(row: int, binning: int) -> str:
    """Name a row of the scan by the row or rows of the file it was made of."""
    if binning == 1:
        return f"detector row {row}"
    return f"detector rows {row * binning} to {row * binning + binning - 1}"
