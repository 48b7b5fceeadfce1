"""AngleMeasurements -> Refinement: the factor graph and the gate.

To add a factor, write it in `factors`.
"""

from tomoslam_stage.refinement.factors import FACTORS
from tomoslam_stage.refinement.gate import Halves, Verdict, nothing_measured, weigh
from tomoslam_stage.refinement.graphing import FactorGraph
from tomoslam_stage.refinement.solve import Solution

__all__ = [
    "FACTORS",
    "FactorGraph",
    "Halves",
    "Solution",
    "Verdict",
    "nothing_measured",
    "weigh",
]
