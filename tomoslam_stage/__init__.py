"""Rotation angle refinement for X-ray tomography: the scan as a SLAM problem.

>>> from tomoslam_stage import refine_theta
>>> refinement = refine_theta(line_integrals, theta)  # doctest: +SKIP
>>> refinement.status, refinement.theta  # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

__all__ = ["compare", "load_scan", "reconstruct", "refine_theta", "write_theta"]


def __getattr__(name: str) -> Any:
    """Import what is heavy only when it is asked for, so that ``--help`` is instant."""
    if name in __all__:
        from tomoslam_stage import stages

        return getattr(stages, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
