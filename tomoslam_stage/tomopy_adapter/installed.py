"""Whether tomopy is there, and what to do where it is not. Nothing else imports it."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from tomoslam_stage.errors import BackendMissingError

HOW_TO_GET_IT = "conda install -c conda-forge tomopy"
"""It is not on the Python registry."""


@cache
def _tomopy() -> ModuleType | ImportError:
    """Import tomopy, once; or keep why it cannot be."""
    try:
        import tomopy
    except ImportError as error:  # also where its shared libraries are missing
        return error
    module: ModuleType = tomopy
    return module


def version() -> str | None:
    """Return tomopy's version, or None where it cannot be imported."""
    tomopy = _tomopy()
    if isinstance(tomopy, ImportError):
        return None
    return str(getattr(tomopy, "__version__", "of unknown version"))


def require(where: str) -> None:
    """Answer for `where`, which needs tomopy, how to get it.

    Raises
    ------
    BackendMissingError
        If tomopy cannot be imported.
    """
    tomopy = _tomopy()
    if isinstance(tomopy, ImportError):
        raise BackendMissingError(
            where,
            f"tomopy is needed and cannot be imported ({tomopy}).",
            f"Get it by `{HOW_TO_GET_IT}` (the Python registry has none), "
            "or do without: `backend: embedded` reconstructs and needs nothing.",
        )


def module(path: str) -> Any:
    """Return the module of tomopy at `path`, such as ``tomopy.prep.stripe``."""
    require(path)
    return import_module(path)
