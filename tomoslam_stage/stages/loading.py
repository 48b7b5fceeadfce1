"""load_scan: a file -> Scan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from tomoslam_stage import scans
from tomoslam_stage.methods import method
from tomoslam_stage.products import Scan, Values
from tomoslam_stage.stages.work import SideOutputs, Work

SIZES = ("n_projections", "n_rows", "n_columns")
"""Side outputs of everything that loads a scan."""


@method
class LoadScan:
    """Open a DXchange scan; everything about it is checked before any work."""

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

    def run(self, work: Work) -> SideOutputs:
        """Leave the scan; find out now whether angles could be written at the end."""
        return loaded(self.opened(work.path), work)

    def opened(self, path: Path) -> Scan:
        """Open the scan at `path`, see `scans.open_scan`."""
        return scans.open_scan(
            path,
            kind=self.kind,
            units=self.units,
            parallel=self.parallel,
            binning=self.binning,
        )


def loaded(scan: Scan, work: Work) -> SideOutputs:
    """Leave `scan` and return its sizes; refuse now what could not be written to at the end."""
    if work.output is None and not work.dry_run:
        scans.check_writable(work.path)
    work.scan = scan
    return {name: getattr(scan, name) for name in SIZES}
