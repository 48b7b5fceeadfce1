"""load_scan: a file -> Scan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import BeforeValidator, Field

from tomoslam_stage import scans
from tomoslam_stage.methods import method
from tomoslam_stage.products import Scan, Values
from tomoslam_stage.stages.work import SideOutputs, Work

SIZES = ("n_projections", "n_rows", "n_columns")
"""Side outputs of everything that loads a scan."""


def as_text(given: Any) -> Any:
    """Write 12, or [12, 40], as ``12,40``, in which FROM:BEFORE may stand as well."""
    listed = given if isinstance(given, list | tuple) else [given]
    numbers = all(isinstance(each, int) and not isinstance(each, bool) for each in listed)
    return ",".join(map(str, listed)) if numbers else given


Numbers: TypeAlias = Annotated[
    str, BeforeValidator(as_text, json_schema_input_type=str | int | list[int])
]


@method
class LoadScan:
    """Open a DXchange or NXtomo scan; everything about it is checked before any work."""

    makes: ClassVar = ("scan",)
    gives: ClassVar = SIZES
    leaves: ClassVar[tuple[Values, ...]] = ("line_integrals",)

    kind: scans.Kind = "auto"
    """What the data are: ``counts``, ``transmission`` or ``line_integrals``."""
    units: scans.Units = "auto"
    """Units of theta, ``deg`` or ``rad``; ``auto`` believes the file."""
    parallel: bool = False
    """Take the beam for parallel, whatever distances the file holds."""
    binning: Annotated[int, Field(ge=1)] = 1
    """Detector pixels averaged along rows and along columns."""
    drop_frames: Numbers = ""
    """Frames that are left out, as in 12,40:43; their angles, too, where they have any."""
    keep_frames: Numbers = ""
    """The only frames that are not left out; they stay even where they look bad."""
    drop_angles: Numbers = ""
    """Entries of theta for which there is no frame."""

    def run(self, work: Work) -> SideOutputs:
        """Leave the scan."""
        return loaded(self.opened(work.path), work)

    def opened(self, path: Path) -> Scan:
        """Open the scan at `path`, see `scans.open_scan`."""
        return scans.open_scan(
            path,
            kind=self.kind,
            units=self.units,
            parallel=self.parallel,
            binning=self.binning,
            frames=scans.Choice(self.drop_frames, self.keep_frames, self.drop_angles),
        )


def loaded(scan: Scan, work: Work) -> SideOutputs:
    """Leave `scan` and return its sizes."""
    work.scan = scan
    return {name: getattr(scan, name) for name in SIZES}
