"""AngleMeasurements: steps as features show them, and loop closures as projections show them."""

from tomoslam_stage.angles.closing import LoopClosure
from tomoslam_stage.angles.triplets import Triplets

__all__ = ["LoopClosure", "Triplets"]
