"""What an entry of a pipeline may name: each stage's parameters, and what it does.

To add a stage, write it in a file of its own and name it in `STAGES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tomoslam_stage.stages.comparing import Compare
from tomoslam_stage.stages.loading import LoadScan
from tomoslam_stage.stages.reconstructing import Reconstruct
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Stage, Work
from tomoslam_stage.stages.writing import WriteTheta

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from tomoslam_stage.products import Refinement

STAGES: Mapping[str, type[Stage]] = {
    "load_scan": LoadScan,
    "refine_theta": RefineTheta,
    "reconstruct": Reconstruct,
    "compare": Compare,
    "write_theta": WriteTheta,
}

__all__ = ["STAGES", "Stage", "Work", "refine_theta"]


def refine_theta(projections: Any, theta: ArrayLike, **parameters: Any) -> Refinement:
    """Refine the rotation angles of projections in memory, or in an open HDF5 dataset.

    Parameters
    ----------
    projections
        (n, row, column) line integrals, minus-log and flat-fielded; read in blocks.
    theta
        (n,) radians: the recorded angles.
    parameters
        Those of the stage ``refine_theta``, as a pipeline gives them:
        ``tracks={"detector": "surf"}``.

    Returns
    -------
    `Refinement`: its ``theta`` are the angles that stand.

    Raises
    ------
    PipelineError
        For an unknown parameter, or a value that does not fit.
    ScanError
        If the shapes do not fit each other.
    """
    import numpy as np

    from tomoslam_stage.methods import checked
    from tomoslam_stage.scans import scan_of
    from tomoslam_stage.stages.work import Clock

    scan = scan_of(projections, np.asarray(theta, np.float64))
    return checked(RefineTheta, parameters, "refine_theta").refine(scan, Clock({}))
