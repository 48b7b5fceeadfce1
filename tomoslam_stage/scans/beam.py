"""Is the beam parallel? What the distances stored in a file say about it.

A point z behind the axis, seen from a source at distance D, is magnified by 1 / (1 + z / D) more
than one on the axis. At the edge of the field of view, half a detector width from the axis, that
moves it by about ``half_width_px * half_width / D`` columns. Synchrotron files rightly hold
distances of tens of metres: only a beam that moves points by more than `TOLERATED_PX` is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.scans.strings import read_text, read_units

if TYPE_CHECKING:
    from collections.abc import Iterator

    from h5py import File

TOLERATED_PX = 0.5
"""Detector columns that divergence may move a point at the edge of the field of view."""
TOLERATED_MAGNIFICATION = 1.05
"""Taken instead where the size of a pixel is unknown."""

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "micron": 1e-6, "nm": 1e-9}

SOURCE_OBJECT = ("source_object_distance", "source_sample_distance", "source_to_sample_distance")
SOURCE_DETECTOR = ("source_detector_distance", "source_to_detector_distance")
OBJECT_DETECTOR = (
    "detector_distance",
    "sample_detector_distance",
    "object_detector_distance",
    "sample_to_detector_distance",
)
PIXEL = ("x_pixel_size", "pixel_size_x", "pixel_size")
GEOMETRY = ("geometry", "beam_geometry", "scan_geometry")


@dataclass(frozen=True)
class Beam:
    """Distances as the file gives them; None where it does not."""

    source_object: float | None = None
    """m, from the source to the rotation axis."""
    object_detector: float | None = None
    """m, from the rotation axis to the detector."""
    pixel: float | None = None
    """m, width of a detector pixel."""
    declared: str | None = None
    """The geometry in words."""

    @property
    def magnification(self) -> float | None:
        """Geometric magnification, where both distances are known."""
        if not self.source_object or self.object_detector is None:
            return None
        return 1 + self.object_detector / self.source_object

    def shift_px(self, columns: int) -> float | None:
        """Columns that divergence moves a point at the edge of the field of view."""
        if self.magnification is None or self.pixel is None or self.source_object is None:
            return None
        half_width = columns / 2 * self.pixel / self.magnification
        return columns / 2 * half_width / self.source_object

    def why_divergent(self, columns: int) -> str | None:
        """Say in numbers why the beam cannot pass for parallel; None if it can."""
        if self.declared and any(word in self.declared.lower() for word in ("cone", "fan")):
            return f"the file declares a {self.declared!r} geometry"
        shift = self.shift_px(columns)
        if shift is not None:
            return self._in_numbers(f", moving edge points by {shift:.1f} px", shift > TOLERATED_PX)
        magnified = (self.magnification or 1) > TOLERATED_MAGNIFICATION
        return self._in_numbers("", magnified)

    def _in_numbers(self, consequence: str, divergent: bool) -> str | None:
        if not divergent or self.source_object is None or self.object_detector is None:
            return None
        return (
            f"the source is {1e3 * self.source_object:.4g} mm before and the detector "
            f"{1e3 * self.object_detector:.4g} mm behind the axis "
            f"(magnification {self.magnification:.3g}{consequence})"
        )


def read_beam(file: File, groups: tuple[str, ...]) -> Beam:
    """Collect what the file says about the geometry of the beam, in these `groups`."""
    found = dict(_leaves(file, groups))
    source_object = _first(found, SOURCE_OBJECT) or _in_group(found, "source", "distance")
    object_detector = _first(found, OBJECT_DETECTOR) or _in_group(found, "detector", "distance")
    source_detector = _first(found, SOURCE_DETECTOR)
    if object_detector is None and source_detector and source_object:
        object_detector = source_detector - source_object
    if source_object is None and source_detector and object_detector:
        source_object = source_detector - object_detector
    return Beam(source_object, object_detector, _first(found, PIXEL), _declared(found))


def _leaves(file: File, groups: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield path and dataset of every small dataset where geometry is kept."""
    import h5py

    collected: list[tuple[str, Any]] = []

    def keep(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.size == 1:
            collected.append((name.lower(), node))

    for place in groups:
        group = file.get(place)
        if isinstance(group, h5py.Group):
            group.visititems(keep)
    yield from collected


def _first(found: dict[str, Any], names: tuple[str, ...]) -> float | None:
    for path, node in found.items():
        if path.rsplit("/", 1)[-1] in names:
            return _metres(node)
    return None


def _in_group(found: dict[str, Any], group: str, name: str) -> float | None:
    for path, node in found.items():
        if f"/{path}".endswith(f"/{group}/{name}"):
            return _metres(node)
    return None


def _metres(node: Any) -> float | None:
    """Return the length in metres; DXchange says SI where no unit is given."""
    if node.dtype.kind not in "iuf":
        return None
    value = abs(float(np.asarray(node[()]).ravel()[0])) * METRES.get(read_units(node) or "m", 1.0)
    return value if np.isfinite(value) and value > 0 else None


def _declared(found: dict[str, Any]) -> str | None:
    for path, node in found.items():
        if path.rsplit("/", 1)[-1] in GEOMETRY and node.dtype.kind in "OS":
            return read_text(node[()]) or None
    return None
