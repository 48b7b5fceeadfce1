"""HDF5 files: reading scans, writing angles back, and the files of results.

To add a layout, write a module like `dxchange` that answers with the same `Contents`. To add a
check, write a function in `checks` and name it in its table.
"""

from __future__ import annotations

from tomoslam_stage.scans.kind import Kind
from tomoslam_stage.scans.opening import (
    describe_scan,
    open_as_stored,
    open_scan,
    read_truth,
)
from tomoslam_stage.scans.provenance import ProcessRecord, now
from tomoslam_stage.scans.simulated import ScanContent, create_scan
from tomoslam_stage.scans.slices import write_slices, write_tiffs
from tomoslam_stage.scans.sources import (
    ArraySource,
    BinnedSource,
    Stack,
    binned,
    line_integrals,
    prepared,
    scan_of,
)
from tomoslam_stage.scans.spool import blocks, spooled
from tomoslam_stage.scans.theta import Units
from tomoslam_stage.scans.transaction import check_writable
from tomoslam_stage.scans.writing import revert, write_companion, write_theta

__all__ = [
    "ArraySource",
    "BinnedSource",
    "Kind",
    "ProcessRecord",
    "ScanContent",
    "Stack",
    "Units",
    "binned",
    "blocks",
    "check_writable",
    "create_scan",
    "describe_scan",
    "line_integrals",
    "now",
    "open_as_stored",
    "open_scan",
    "prepared",
    "read_truth",
    "revert",
    "scan_of",
    "spooled",
    "write_companion",
    "write_slices",
    "write_theta",
    "write_tiffs",
]
