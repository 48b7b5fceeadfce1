"""Which layout a file has: it is recognised by what is in it.

To add a layout, write a module like `nxtomo` with a class that is a `contents.Layout`, and a line
in `recognised`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomoslam_stage.scans.dxchange import DxChange
from tomoslam_stage.scans.nxtomo import find_nxtomo

if TYPE_CHECKING:
    from pathlib import Path

    from h5py import File

    from tomoslam_stage.scans.contents import Contents, Layout


def recognised(file: File, path: Path) -> Layout:
    """Return the layout of an open file; DXchange where it is like neither.

    Raises
    ------
    ScanError
        If it holds several scans.
    """
    if "exchange" in file:
        return DxChange()
    return find_nxtomo(file, path.name) or DxChange()


def read_contents(file: File, path: Path) -> Contents:
    """Look at everything in a file but the pixels."""
    return recognised(file, path).read(file, path)
