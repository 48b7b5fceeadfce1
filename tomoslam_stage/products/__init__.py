"""The products of the stations, in the order in which a scan passes them.

    Scan -> Tracks -> AngleMeasurements -> Refinement -> Reconstructions -> Comparison

Conventions, kept everywhere:

* projections are indexed (projection, row, column); rows grow downwards, columns to the right,
  pixel centres lie on whole numbers;
* angles are radians, unwrapped; degrees exist in keys and file datasets only, whose names end
  ``_deg``, and inside `scans`;
* ``u = X cos(theta) + Z sin(theta)`` is the column of the point (X, Z), counted from the axis,
  in a parallel beam; a projection's detector column is ``u + axis``;
* a slice is an array (z, x) whose middle ``(n - 1) / 2`` lies on the axis.
"""

from tomoslam_stage.products.arrays import Floats, Integers, Pixels
from tomoslam_stage.products.features import AngleMeasurements, Features, Tracks
from tomoslam_stage.products.refinement import (
    Event,
    Evidence,
    Geometry,
    Quadratic,
    Refinement,
    Solve,
    StageNoise,
    Status,
)
from tomoslam_stage.products.scan import (
    Along,
    Conversion,
    ProjectionSource,
    Raw,
    Scan,
    Values,
)
from tomoslam_stage.products.slices import Comparison, Reconstruction, Reconstructions, Truth

__all__ = [
    "Along",
    "AngleMeasurements",
    "Comparison",
    "Conversion",
    "Event",
    "Evidence",
    "Features",
    "Floats",
    "Geometry",
    "Integers",
    "Pixels",
    "ProjectionSource",
    "Quadratic",
    "Raw",
    "Reconstruction",
    "Reconstructions",
    "Refinement",
    "Scan",
    "Solve",
    "StageNoise",
    "Status",
    "Tracks",
    "Truth",
    "Values",
]
