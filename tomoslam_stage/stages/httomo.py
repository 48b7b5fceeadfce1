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
    """Open a DXchange scan as HTTomo does: flats and the logarithm are entries of their own.

    Where the entries leave them out, they are done before the angles are refined.
    """

    makes: ClassVar = ("scan",)
    gives: ClassVar = SIZES
    leaves: ClassVar[tuple[Values, ...]] = ("counts", "transmission", "line_integrals")

    data_path: str = "auto"
    """``auto`` or ``/exchange/data``."""
    image_key_path: str | None = None
    """DXchange has none."""
    rotation_angles: Any = "auto"
    """``auto`` or ``data_path: /exchange/theta``."""
    darks: Any = None
    """None, or ``file: input_data`` and ``data_path: /exchange/data_dark``."""
    flats: Any = None
    """None, or ``file: input_data`` and ``data_path: /exchange/data_white``."""
    preview: Any = None
    """Cropping is not taken: the refinement reads what it needs."""

    def __post_init__(self) -> None:
        _check_path("data_path", self.data_path, "/exchange/data")
        if self.image_key_path not in (None, "auto"):
            _refuse("image_key_path", self.image_key_path, "null is needed: DXchange has no keys")
        _check_path("rotation_angles", _angles_path(self.rotation_angles), "/exchange/theta")
        _check_frames("darks", self.darks, "/exchange/data_dark")
        _check_frames("flats", self.flats, "/exchange/data_white")
        if self.preview is not None and any(dict(self.preview).values()):
            _refuse("preview", self.preview, "null is needed; `rows` of reconstruct chooses slices")

    def run(self, work: Work) -> SideOutputs:
        """Leave the scan; find out now whether angles could be written at the end."""
        return loaded(self.opened(work.path), work)

    def opened(self, path: Path) -> Scan:
        """Open the scan at `path`, its values as they are stored."""
        return scans.open_as_stored(path)


def _angles_path(given: Any) -> Any:
    if isinstance(given, Mapping) and set(given) == {"data_path"}:
        return given["data_path"]
    return given


def _check_path(key: str, given: Any, needed: str) -> None:
    if given != "auto" and f"/{given}".replace("//", "/") != needed:
        _refuse(key, given, f"auto or {needed} is needed: scans are read in the DXchange layout")


def _check_frames(key: str, given: Any, needed: str) -> None:
    if given is None:
        return
    if not isinstance(given, Mapping) or given.get("file") != "input_data":
        _refuse(key, given, f"null, or `file: input_data` and `data_path: {needed}` are needed")
    _check_path(f"{key}.data_path", given.get("data_path"), needed)


def _refuse(key: str, given: Any, needed: str) -> None:
    raise PipelineError(f"{WHERE}.{key}", f"{given!r}; {needed}.")
