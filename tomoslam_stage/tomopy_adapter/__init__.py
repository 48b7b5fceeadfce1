"""tomopy, for those who have it: its reconstruction with its traps, its functions for projections.

Written against tomopy 1.15.2 (Gursoy et al., J. Synchrotron Rad. 21 (2014) 1188). No other part of
the project imports it. What may be said without it (which functions exist, and how they are fed)
is in `allowed`; whatever needs it raises `BackendMissingError` where it is not installed.
"""

from __future__ import annotations

from tomoslam_stage.tomopy_adapter.allowed import ALLOWED, REFUSED, How, allowed
from tomoslam_stage.tomopy_adapter.analytic import fbp, gridrec
from tomoslam_stage.tomopy_adapter.calling import along, call, fills, keywords, recon_keywords
from tomoslam_stage.tomopy_adapter.installed import HOW_TO_GET_IT, require, version
from tomoslam_stage.tomopy_adapter.iterative import iterate, sirt

__all__ = [
    "ALLOWED",
    "HOW_TO_GET_IT",
    "REFUSED",
    "How",
    "allowed",
    "along",
    "call",
    "fbp",
    "fills",
    "gridrec",
    "iterate",
    "keywords",
    "recon_keywords",
    "require",
    "sirt",
    "version",
]
