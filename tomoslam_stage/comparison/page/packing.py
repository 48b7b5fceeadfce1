"""Pictures and arrays as text that a page can hold."""

from __future__ import annotations

import zlib
from base64 import b64encode
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from tomoslam_stage.products import Pixels

DEEPEST = 65535
"""Greys of a picture whose window is chosen by the reader."""
QUALITY = 82
"""Of JPEG, where pictures only carry what is drawn over them."""
DIGITS = 6


def packed(values: NDArray[Any]) -> str:
    """Little-endian bytes of `values`, deflated, as text."""
    ordered = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    return b64encode(zlib.compress(ordered.tobytes(), 6)).decode("ascii")


def deep(image: NDArray[Any], limits: tuple[float, float]) -> str:
    """Pack `image` (row, column) as 16 bits between `limits`, all low bytes before all high ones.

    What is not finite becomes the lowest grey.
    """
    low, high = limits
    share = np.nan_to_num((image - low) / (high - low), nan=0.0, posinf=1.0, neginf=0.0)
    greys = np.rint(np.clip(share, 0, 1) * DEEPEST).astype(np.uint16)
    # Apart, the high bytes deflate well; the low ones are noise.
    return packed(np.stack([greys & 255, greys >> 8]).astype(np.uint8))


def jpeg(image: Pixels, limits: tuple[float, float]) -> str:
    """Draw `image` (row, column) in 8 bits between `limits`, as a data address."""
    from PIL import Image

    low, high = limits
    share = np.nan_to_num((image - low) / (high - low), nan=0.0, posinf=1.0, neginf=0.0)
    content = BytesIO()
    greys = Image.fromarray(np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8))
    greys.save(content, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + b64encode(content.getvalue()).decode("ascii")


def shrunk(image: Pixels, rows: int, columns: int) -> Pixels:
    """(row // rows, column // columns) means of blocks; what is left over is dropped."""
    height, width = image.shape[0] // rows, image.shape[1] // columns
    whole = image[: height * rows, : width * columns]
    return np.asarray(whole.reshape(height, rows, width, columns).mean(axis=(1, 3)), np.float32)


def rounded(values: Iterable[float]) -> list[float | None]:
    """Numbers with as many digits as a reader can see; None for what is not finite."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values]
