"""The products of the stations, in the order in which a scan passes them.

    Scan -> Tracks -> AngleMeasurements -> Refinement -> Reconstructions -> Comparison

Conventions, kept everywhere:

* projections are indexed (projection, row, column); rows grow downwards, columns to the right,
  pixel centres lie on whole numbers;
* angles are radians, unwrapped; degrees exist in keys and file datasets only, whose names end
  ``_deg``, and inside `scans`;
* ``u = X cos(theta) + Z sin(theta)`` is the column of the point (X, Z), counted from the axis,
  in a parallel beam; its detector column is ``u + axis + roll (row - middle) + shift``;
* a slice is an array (z, x) whose middle ``(n - 1) / 2`` lies on the axis.
"""

from tomoslam_stage.products.arrays import Floats, Integers, Pixels
from tomoslam_stage.products.features import AngleMeasurements, Closures, Features, Tracks
from tomoslam_stage.products.geometry import (
    STILL,
    UNKNOWNS,
    Geometry,
    Layout,
    Quadratic,
    Solve,
    Unknown,
)
from tomoslam_stage.products.refinement import (
    Event,
    Evidence,
    Refinement,
    Rigidity,
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
    "STILL",
    "UNKNOWNS",
    "Along",
    "AngleMeasurements",
    "Closures",
    "Comparison",
    "Conversion",
    "Event",
    "Evidence",
    "Features",
    "Floats",
    "Geometry",
    "Integers",
    "Layout",
    "Pixels",
    "ProjectionSource",
    "Quadratic",
    "Raw",
    "Reconstruction",
    "Reconstructions",
    "Refinement",
    "Rigidity",
    "Scan",
    "Solve",
    "StageNoise",
    "Status",
    "Tracks",
    "Truth",
    "Unknown",
    "Values",
]
