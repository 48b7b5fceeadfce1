"""HDF5 files: reading scans, writing angles back, and the files of results.

To add a layout, write a module like `nxtomo` and a line in `layouts`. To add a check, write a
function in `checks` and name it in its table.
"""

from __future__ import annotations

from tomoslam_stage.scans.angles import StoredAngles, find_paths, read_angles
from tomoslam_stage.scans.kind import Kind
from tomoslam_stage.scans.opening import (
    describe_scan,
    open_as_stored,
    open_scan,
    read_truth,
)
from tomoslam_stage.scans.pairing import Choice
from tomoslam_stage.scans.provenance import ProcessRecord, now
from tomoslam_stage.scans.simulated import ScanContent, create_scan, write_simulated
from tomoslam_stage.scans.slices import write_slices, write_tiffs
from tomoslam_stage.scans.sources import (
    ArraySource,
    BinnedSource,
    Stack,
    binned,
    line_integrals,
    only,
    prepared,
    scan_of,
)
from tomoslam_stage.scans.spool import blocks, spooled
from tomoslam_stage.scans.theta import Units
from tomoslam_stage.scans.writing import (
    check_output,
    check_writable,
    is_written,
    revert,
    write_companion,
    write_theta,
)

__all__ = [
    "ArraySource",
    "BinnedSource",
    "Choice",
    "Kind",
    "ProcessRecord",
    "ScanContent",
    "Stack",
    "StoredAngles",
    "Units",
    "binned",
    "blocks",
    "check_output",
    "check_writable",
    "create_scan",
    "describe_scan",
    "find_paths",
    "is_written",
    "line_integrals",
    "now",
    "only",
    "open_as_stored",
    "open_scan",
    "prepared",
    "read_angles",
    "read_truth",
    "revert",
    "scan_of",
    "spooled",
    "write_companion",
    "write_simulated",
    "write_slices",
    "write_theta",
    "write_tiffs",
]
