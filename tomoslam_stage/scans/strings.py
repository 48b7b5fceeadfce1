"""Strings in HDF5 files, in whichever of the many ways they were stored."""

from __future__ import annotations

from typing import Any

import numpy as np


def read_text(value: object) -> str:
    """Turn a stored string (bytes, str, an array of one, padded with zeros) into str."""
    flat = np.asarray("" if getattr(value, "shape", ()) is None else value).ravel()
    first = flat[0] if flat.size else ""
    text = first.decode("utf-8", "replace") if isinstance(first, bytes) else str(first)
    return text.strip("\x00 ")


def read_units(dataset: Any) -> str | None:
    """Read the ``units`` attribute; None where there is none or it is empty."""
    return read_text(dataset.attrs["units"]) or None if "units" in dataset.attrs else None
