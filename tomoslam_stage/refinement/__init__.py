"""AngleMeasurements and what other sources say -> Refinement: the factor graph and the gate.

To add a factor, write it in `factors`.
"""

from tomoslam_stage.refinement.factors import FACTORS
from tomoslam_stage.refinement.fusing import (
    Fused,
    Said,
    agree,
    as_one,
    fused,
    honest,
    solver_with,
    with_stage_noise,
)
from tomoslam_stage.refinement.gate import (
    Halves,
    Verdict,
    evidence_of,
    gain_sigma,
    nothing_measured,
    weigh,
)
from tomoslam_stage.refinement.graphing import FactorGraph
from tomoslam_stage.refinement.landmarks import Landmarks
from tomoslam_stage.refinement.rows import rigidity
from tomoslam_stage.refinement.solve import Solution
from tomoslam_stage.refinement.stage_noise import lapses, stage_noise

__all__ = [
    "FACTORS",
    "FactorGraph",
    "Fused",
    "Halves",
    "Landmarks",
    "Said",
    "Solution",
    "Verdict",
    "agree",
    "as_one",
    "evidence_of",
    "fused",
    "gain_sigma",
    "honest",
    "lapses",
    "nothing_measured",
    "rigidity",
    "solver_with",
    "stage_noise",
    "weigh",
    "with_stage_noise",
]
