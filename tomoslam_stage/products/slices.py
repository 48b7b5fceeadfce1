"""Reconstructed slices, and what comparing them shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from tomoslam_stage.products.arrays import Floats, Integers, Pixels


@dataclass(frozen=True)
class Reconstruction:
    """Slices reconstructed with one set of angles."""

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column of the axis that was used, px."""
    rows: Integers
    """(r,) detector rows of the slices."""
    slices: Pixels
    """(r, z, x) attenuation per pixel."""
    method: str
    """Backend and algorithm, for instance ``embedded fbp``."""
    convergence: Floats = field(default_factory=lambda: np.empty(0))
    """(iterations,) rms of what is left of the sinograms; empty where nothing iterates."""


Reconstructions: TypeAlias = Mapping[str, Reconstruction]
"""By name: ``recorded``, ``refined`` and, for simulated scans, ``true``; with ``_even`` or ``_odd``
after the name from every other projection alone."""


@dataclass(frozen=True)
class Truth:
    """The true angles of a simulated scan. Only the report may look at them."""

    theta: Floats
    """(n,) radians."""
    axis: float | None = None
    """Detector column, px."""
    shift: Floats | None = None
    """(n,) px of the file that each projection lies to the right; None where the sample stood
    still."""


@dataclass(frozen=True)
class Comparison:
    """Numbers that compare the reconstructions by name, all shown without a verdict."""

    sharpness: Mapping[str, Mapping[str, float]]
    """Metric -> name of the reconstruction -> value."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Against the truth, where the scan is simulated: degrees, and the ratio of equation 7."""
    similarity: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Metric -> name -> value: ``psnr`` (dB) and ``ssim`` against the slices of the true angles."""
    frc_frequency: Floats = field(default_factory=lambda: np.empty(0))
    """(f,) cycles per px."""
    frc_threshold: Floats = field(default_factory=lambda: np.empty(0))
    """(f,) the correlation that the resolution is read off at."""
    frc: Mapping[str, Floats] = field(default_factory=dict)
    """Name -> (f,) correlation of its even with its odd half; empty where there are no halves."""
    frc_resolution_px: Mapping[str, float] = field(default_factory=dict)
    """Name -> px: period at which `frc` first falls below the threshold."""
    edge_width_px: Mapping[str, float] = field(default_factory=dict)
    """Name -> px in which the most changed edge rises from 10 to 90 %; nan where it does not."""
