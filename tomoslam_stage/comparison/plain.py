"""Anything a report tells, as strict JSON and as text."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats

LIST_OF_NUMBERS = re.compile(r"\[[\s\d.,eE+\-]*(?:null[\s\d.,eE+\-]*)*\]")


def plain(value: Any) -> Any:
    """Turn `value` into what strict JSON can say; nan and infinity become None.

    Raises
    ------
    TypeError
        For a value that is no number, text, path, sequence, mapping or dataclass.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    elif is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    match value:
        case float():
            return value if math.isfinite(value) else None
        case None | int() | str():
            return value
        case Path():
            return str(value)
        case Mapping():
            return {str(key): plain(entry) for key, entry in value.items()}
        case Sequence():
            return [plain(entry) for entry in value]
    raise TypeError(f"a report cannot hold {value!r} of type {type(value).__name__}")


def as_json(made: Mapping[str, Any]) -> bytes:
    """Write a report as strict JSON, readable by people too: numbers of a list in one line."""
    text = json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False)
    text = LIST_OF_NUMBERS.sub(lambda found: " ".join(found[0].split()), text)
    return (text + "\n").encode()


def one_column(values: Floats) -> bytes:
    """One number a line, with every digit it takes to read the same float64 again."""
    return "".join(f"{value!r}\n" for value in values.tolist()).encode()
