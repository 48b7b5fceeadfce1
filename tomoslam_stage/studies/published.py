"""The numbers of the paper's section 5."""

from __future__ import annotations

RATIO = 2.75
"""Equation 7: RMSE of the stepper over that of the graph."""
STEP = 10.0
"""Degrees: the CV step it was reached with."""
SIGMA_ENCODER = 0.05
"""Degrees: standard deviation of the stepper."""
NOISIER = 2.4
"""How many times noisier a stepper gives the same accuracy with the graph."""
SECONDS = 0.053
"""To compute all 360 angles, on twelve cores."""
ANGLES = 360
"""Number of projections."""
BEST_STEPS, BIASED_STEP = (4.0, 5.0, 7.0, 10.0), 7.0
"""Degrees: the steps with the least errors, and the one of them that is biased."""
