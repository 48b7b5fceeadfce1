"""The published experiments, re-run on a scan of one's own, or on the paper's case simulated.

To add a study, write it in a file of its own and name it in `STUDIES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage.studies.case import Case, given, simulated
from tomoslam_stage.studies.error_ratio import ErrorRatio
from tomoslam_stage.studies.histograms import Histograms
from tomoslam_stage.studies.sd_card import SdCard
from tomoslam_stage.studies.step_size import StepSize
from tomoslam_stage.studies.study import Claim, Outcome, Study
from tomoslam_stage.studies.timing import Timing
from tomoslam_stage.studies.writing import write_outcome, write_page

if TYPE_CHECKING:
    from collections.abc import Mapping

STUDIES: Mapping[str, type[Study]] = {
    "step-size": StepSize,
    "histograms": Histograms,
    "error-ratio": ErrorRatio,
    "timing": Timing,
    "sd-card": SdCard,
}
"""Name -> study, in the order of the paper."""

__all__ = [
    "STUDIES",
    "Case",
    "Claim",
    "Outcome",
    "Study",
    "given",
    "simulated",
    "write_outcome",
    "write_page",
]
