"""What an entry of a pipeline may name: each stage's parameters, and what it does.

To add a stage, write it in a file of its own and name it in `STAGES`; `MODULES` adds what may
stand in a pipeline beside our own stages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage import tomopy_adapter
from tomoslam_stage.stages.comparing import Compare
from tomoslam_stage.stages.functions import (
    compare,
    load_scan,
    reconstruct,
    refine_theta,
    write_theta,
)
from tomoslam_stage.stages.httomo import StandardTomo
from tomoslam_stage.stages.loading import LoadScan
from tomoslam_stage.stages.modules import Module, Modules
from tomoslam_stage.stages.preparing import Functions
from tomoslam_stage.stages.recon import Recon
from tomoslam_stage.stages.reconstructing import Reconstruct
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Fitted, Loader, Stage, Work, Writer
from tomoslam_stage.stages.writing import WriteTheta

if TYPE_CHECKING:
    from collections.abc import Mapping

STAGES: Mapping[str, type[Stage]] = {
    "load_scan": LoadScan,
    "refine_theta": RefineTheta,
    "reconstruct": Reconstruct,
    "compare": Compare,
    "write_theta": WriteTheta,
}

TOMOPY: Modules = {
    path: Module(Functions(path), tomopy_adapter.REFUSED.get(path, {}), tomopy_adapter.require)
    for path in tomopy_adapter.ALLOWED
}

MODULES: Modules = {
    "tomoslam_stage.stages": Module(STAGES),
    "httomo.data.hdf.loaders": Module({"standard_tomo": StandardTomo}),
    **TOMOPY,
    "tomopy.recon.algorithm": Module(
        {"recon": Recon},
        tomopy_adapter.REFUSED["tomopy.recon.algorithm"],
        tomopy_adapter.require,
    ),
}
"""By ``module_path``: everything that an entry may name; all else is refused."""

__all__ = [
    "MODULES",
    "STAGES",
    "Fitted",
    "Loader",
    "Modules",
    "Stage",
    "Work",
    "Writer",
    "compare",
    "load_scan",
    "reconstruct",
    "refine_theta",
    "write_theta",
]
