"""HTTomo's loader entry: a file -> Scan, as the detector stored it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from tomoslam_stage import scans
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import method
from tomoslam_stage.products import Scan, Values
from tomoslam_stage.stages.loading import SIZES, loaded
from tomoslam_stage.stages.work import SideOutputs, Work

WHERE = "standard_tomo"


@method
class StandardTomo:
    """Open a scan as HTTomo does: flats and the logarithm are entries of their own.

    Where the entries leave them out, they are done before the angles are refined.
    """

    makes: ClassVar = ("scan",)
    gives: ClassVar = SIZES
    leaves: ClassVar[tuple[Values, ...]] = ("counts", "transmission", "line_integrals")

    data_path: str = "auto"
    """``auto``, or where the scan has its projections."""
    image_key_path: str | None = None
    """Null, ``auto``, or where an NXtomo entry tells its frames apart."""
    rotation_angles: Any = "auto"
    """``auto``, or ``data_path:`` where the scan has its angles."""
    darks: Any = None
    """Null, or ``file: input_data``, or the scan's path, and ``data_path: /exchange/data_dark``."""
    flats: Any = None
    """Null, or the same with ``data_path: /exchange/data_white``."""
    preview: Any = None
    """Null. Cropping is not taken: the refinement reads what it needs."""

    def __post_init__(self) -> None:
        if not isinstance(_angles_path(self.rotation_angles), str):
            needed = "auto, or `data_path: ` and a path are needed"
            _refuse("rotation_angles", self.rotation_angles, needed)
        _check_frames("darks", self.darks)
        _check_frames("flats", self.flats)
        if self.preview is not None and any(dict(self.preview).values()):
            _refuse("preview", self.preview, "null is needed; `rows` of reconstruct chooses slices")

    def run(self, work: Work) -> SideOutputs:
        """Leave the scan."""
        return loaded(self.opened(work.path), work)

    def opened(self, path: Path) -> Scan:
        """Open the scan at `path`, its values as they are stored.

        Raises
        ------
        PipelineError
            For a path in the file that is not what its layout has there, or another file.
        """
        for key in ("darks", "flats"):
            _check_file(key, getattr(self, key), path)
        found = scans.find_paths(path)
        given = {
            "data_path": self.data_path,
            "image_key_path": self.image_key_path,
            "rotation_angles": _angles_path(self.rotation_angles),
            "darks.data_path": _frames_path(self.darks),
            "flats.data_path": _frames_path(self.flats),
        }
        for key, place in given.items():
            if place not in (None, "auto") and f"/{place.strip('/')}" not in found[key]:
                needed = f"auto or {found[key][0]}" if found[key] else "null"
                _refuse(key, place, f"{needed} is needed for {path.name}")
        return scans.open_as_stored(path)


def _angles_path(given: Any) -> Any:
    if isinstance(given, Mapping) and set(given) == {"data_path"}:
        return given["data_path"]
    return given


def _frames_path(given: Any) -> str | None:
    return None if given is None else given["data_path"]


def _check_frames(key: str, given: Any) -> None:
    told = isinstance(given, Mapping) and all(
        isinstance(given.get(name), str) for name in ("file", "data_path")
    )
    if given is not None and not told:
        needed = "null, or `file: input_data` and `data_path: ` and a path are needed"
        _refuse(key, given, needed)


def _check_file(key: str, given: Any, scan: Path) -> None:
    """Flats and darks of another file would not be those that the scan is normalized with."""
    file = "input_data" if given is None else given["file"]
    if file != "input_data" and Path(file).resolve() != scan.resolve():
        _refuse(f"{key}.file", file, f"input_data is needed, or the path of {scan.name} itself")


def _refuse(key: str, given: Any, needed: str) -> None:
    raise PipelineError(f"{WHERE}.{key}", f"{given!r}; {needed}.")
