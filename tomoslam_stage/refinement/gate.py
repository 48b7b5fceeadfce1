"""The gate: refined angles stand only if data that did not make them says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from tomoslam_stage.geometry import around, rms, rms_difference
from tomoslam_stage.methods import method
from tomoslam_stage.products import Evidence

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.products import AngleMeasurements, Floats, Rigidity, Status, Tracks

SECTORS = 8
"""Parts of the turn over which the fall of the residual is averaged on its own."""


@dataclass(frozen=True)
class Verdict:
    """What the gate says, and why."""

    status: Status
    reason: str


@dataclass(frozen=True)
class Halves:
    """The angles that all tracks give, and those of two disjoint halves of them."""

    whole: Floats
    """(n,) radians."""
    first: Floats
    """(n,) radians."""
    second: Floats
    """(n,) radians."""
    measured: float
    """Triplets that the poorer half measured, in units of those that all tracks measured."""

    @property
    def error(self) -> float:
        """Radians: the error of `whole`, its mean removed.

        The halves have independent errors, larger than those of the whole by the square root of
        two; so half their difference has the size of an error of the whole.
        """
        return rms_difference(self.first, self.second) / 2

    def error_of(self, recorded: Floats) -> float:
        """Radians: the error of the recorded angles; that of `whole` is in the change too."""
        change = rms_difference(self.whole, recorded)
        return float(np.sqrt(max(change**2 - self.error**2, 0.0)))

    def excess(self, sigma: Floats) -> float:
        """How much the error exceeds `sigma` (n,), at least 1; both count from the angle held."""
        shown = rms(self.first - self.second) / 2
        said = rms(sigma)
        return max(1.0, shown / said) if said > 0 else 1.0


@method
class Gate:
    """Weighs the evidence: halves and unused rows for the refined angles, feature rows against."""

    half_share: Annotated[float, Field(gt=0, le=1)] = 0.7
    """Largest error of the refined angles, as two halves of the data show it, in units of the error
    of the recorded ones."""
    half_measured: Annotated[float, Field(ge=0, le=1)] = 0.15
    """Fewest triplets either half must measure, in units of those that all tracks measured: halves
    that measure nothing agree on the recorded angles."""
    sigma_share: Annotated[float, Field(gt=0)] = 0.45
    """Largest sigma of the refined angles, in units of the error of the recorded ones, where it
    allows for all that is known: on a smooth object all rows, used or not, err together."""
    significance: Annotated[float, Field(ge=0)] = 3.0
    """Smallest z score of the fall of the reprojection residual on unused rows."""
    most_moved: Annotated[float, Field(gt=0)] = 0.04
    """How far rows of features may move as the scan goes on, px of the scan as it is refined."""
    most_cone: Annotated[float, Field(gt=0)] = 0.25
    """How far they may move apart with depth, px of the scan as it is refined."""
    rows_significance: Annotated[float, Field(ge=0)] = 4.0
    """Standard errors from which on either of these is no chance."""

    def judge(self, evidence: Evidence) -> Verdict:
        """Accept the refined angles or keep the recorded ones, with the reason in numbers."""
        halves = (
            "two halves of the data put the error of the refined angles at "
            f"{evidence.half_error_deg:.3g} degrees and that of the recorded ones at "
            f"{evidence.recorded_error_deg:.3g}"
        )
        before, after = evidence.residual_recorded**2, evidence.residual_refined**2
        fall = 1 - after / before if before > 0 else 0.0
        unused = (
            "on rows that were not used the squared reprojection residual "
            f"{'falls' if fall >= 0 else 'rises'} by {abs(fall):.1%} "
            f"({evidence.residual_gain_sigma:+.1f} standard errors over rows and parts of the turn)"
        )
        against = [] if evidence.rigidity is None else self._against(evidence.rigidity)
        if evidence.half_error_deg >= self.half_share * evidence.recorded_error_deg:
            against.append(f"{halves}; less than {self.half_share:g} of it is needed")
        if evidence.half_measured < self.half_measured:
            against.append(
                f"half of the tracks measures {evidence.half_measured:.0%} of the triplets that "
                "all of them measure, so that the halves say little; "
                f"{self.half_measured:.0%} is needed"
            )
        if evidence.sigma_deg > self.sigma_share * evidence.recorded_error_deg:
            against.append(
                f"the refined angles are known to {evidence.sigma_deg:.3g} degrees, and the "
                f"recorded ones seem {evidence.recorded_error_deg:.3g} off; less than "
                f"{self.sigma_share:g} of it is needed"
            )
        if fall <= 0 or evidence.residual_gain_sigma < self.significance:
            against.append(f"{unused}; a fall by {self.significance:g} or more is needed")
        if against:
            return Verdict("kept", "; ".join(against))
        return Verdict("accepted", f"{halves}; {unused}")

    def _against(self, rows: Rigidity) -> list[str]:
        """Tell why no choice of angles explains the scan, if it is so."""
        moved, cone = self.most_moved * rows.pixel, self.most_cone * rows.pixel
        against = []
        if rows.moved_px > moved and rows.moved_significance >= self.rows_significance:
            against.append(
                f"rows of features move by {rows.moved_px:.2g} px rms as the scan goes on "
                f"({rows.moved_significance:.1f} standard errors), {moved:.2g} px at most are "
                "allowed: the sample moves by itself or changes its size"
            )
        if abs(rows.cone_px) > cone and abs(rows.cone_significance) >= self.rows_significance:
            against.append(
                "rows of features at top and bottom move apart with depth by "
                f"{abs(rows.cone_px):.2g} px ({abs(rows.cone_significance):.1f} standard errors), "
                f"{cone:.2g} px at most are allowed: the beam is not parallel"
            )
        return against


def nothing_measured(tracks: Tracks, measurements: AngleMeasurements) -> Verdict:
    """Keep the recorded angles, because no triplet of projections gave a measurement."""
    failures = ", ".join(f"{why}: {count}" for why, count in measurements.failures.items())
    return Verdict(
        "kept",
        f"no triplet of projections could be measured ({failures or 'no track runs through one'}); "
        f"{tracks.keypoints.mean():.1f} keypoints a projection gave {tracks.n_features} tracks",
    )


def weigh(recorded: Floats, halves: Halves, squares: Mapping[str, Floats]) -> Evidence:
    """Put numbers to the evidence.

    Parameters
    ----------
    recorded
        (n,) radians.
    halves
        The refined angles, from all tracks and from halves of them.
    squares
        ``recorded`` and ``refined``: (r, n) mean squared residual on rows that were not used, see
        `Reprojection.squares`.
    """
    errors = halves.error, halves.error_of(recorded)
    return evidence_of(recorded, errors, halves.measured, squares)


def evidence_of(
    recorded: Floats, errors: tuple[float, float], measured: float, squares: Mapping[str, Floats]
) -> Evidence:
    """Put numbers to the evidence, see `weigh`.

    Parameters
    ----------
    recorded
        (n,) radians.
    errors
        Radians: of the refined and of the recorded angles, as halves show them.
    measured
        What the poorer half measured, in units of what all data did.
    squares
        ``recorded`` and ``refined``: (r, n) mean squared residual on rows that were not used.
    """
    return Evidence(
        half_error_deg=float(np.rad2deg(errors[0])),
        recorded_error_deg=float(np.rad2deg(errors[1])),
        half_measured=measured,
        residual_recorded=float(np.sqrt(squares["recorded"].mean())),
        residual_refined=float(np.sqrt(squares["refined"].mean())),
        residual_gain_sigma=gain_sigma(squares, recorded),
    )


def gain_sigma(squares: Mapping[str, Floats], theta: Floats) -> float:
    """How consistently the residual falls over rows and parts of the turn, in standard errors.

    The z score of Wilcoxon's signed ranks (Biometrics Bulletin 1 (1945) 80) of the logarithms of
    ``recorded`` over ``refined``, for each row and part: where an object shows the angles best the
    residual falls many times more than elsewhere, which ranks do not mind and a mean would.
    """
    recorded, refined = (by_sector(squares[name], theta) for name in ("recorded", "refined"))
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithms = np.log(recorded / refined)
    changed = logarithms[np.isfinite(logarithms) & (logarithms != 0)]
    n = len(changed)
    if n == 0:
        return 0.0
    ranks = np.argsort(np.argsort(np.abs(changed))) + 1
    spread = np.sqrt(n * (n + 1) * (2 * n + 1) / 6)
    return float((np.sign(changed) * ranks).sum() / spread)


def by_sector(squares: Floats, theta: Floats) -> Floats:
    """(r, part) mean of `squares` (r, n) over parts of the turn, or of what was scanned of it."""
    parts = np.array_split(squares[:, around(theta)], min(SECTORS, len(theta)), axis=1)
    return np.stack([part.mean(axis=1) for part in parts], axis=1)
