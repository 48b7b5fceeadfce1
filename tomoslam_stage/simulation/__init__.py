"""Scans with known true angles, of analytic phantoms that are projected exactly."""

from tomoslam_stage.simulation.angle_errors import ANGLE_ERRORS
from tomoslam_stage.simulation.detector import Detector
from tomoslam_stage.simulation.phantoms import PHANTOMS
from tomoslam_stage.simulation.scanning import Recipe, SimulatedScan, recipe_from, simulate

__all__ = [
    "ANGLE_ERRORS",
    "PHANTOMS",
    "Detector",
    "Recipe",
    "SimulatedScan",
    "recipe_from",
    "simulate",
]
