"""The versions of all that can change a result."""

from __future__ import annotations

import platform
from importlib import metadata

PACKAGES = (
    "tomoslam-stage",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "mahotas",
    "gtsam",
    "finufft",
    "tomopy",
    "h5py",
    "pydantic",
    "matplotlib",
)


def versions() -> dict[str, str | None]:
    """Package -> version, None where it is not installed."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def version(package: str) -> str | None:
    """Version of `package`, None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
