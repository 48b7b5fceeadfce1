"""Tracks -> AngleMeasurements: the steps between projections as their features show them."""

from tomoslam_stage.angles.triplets import Triplets

__all__ = ["Triplets"]
