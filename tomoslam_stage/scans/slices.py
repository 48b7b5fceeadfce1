"""Reconstructed slices as files: one HDF5 file, or one stack of TIFF pages for each set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.scans.fresh import discard, fresh_file, put_in_place, translated

if TYPE_CHECKING:
    from collections.abc import Mapping

    from h5py import File

    from tomoslam_stage.products import Reconstruction, Reconstructions

LARGEST_TIFF = 4_000_000_000
"""Bytes."""


def write_slices(path: Path, reconstructions: Reconstructions) -> None:
    """Write all slices into one HDF5 file that viewers of NeXus files (silx) plot when opened.

    One group for each reconstruction: ``slices`` (row, z, x) in float32, ``rows``, ``z`` and ``x``
    (px from the axis), ``theta_deg``, ``axis_px``.

    Raises
    ------
    ScanError
        If the file cannot be written; an earlier one is then still there.
    """
    with fresh_file(Path(path)) as file:
        file.attrs["NX_class"] = "NXroot"
        for name, reconstruction in reconstructions.items():
            _write_group(file, name, reconstruction)
        if reconstructions:
            file.attrs["default"] = "refined" if "refined" in file else next(iter(reconstructions))


def _write_group(file: File, name: str, reconstruction: Reconstruction) -> None:
    group = file.create_group(name)
    group["slices"] = np.asarray(reconstruction.slices, np.float32)
    group["rows"] = reconstruction.rows
    for axis, size in zip(("z", "x"), reconstruction.slices.shape[1:], strict=True):
        group[axis] = np.arange(size) - (size - 1) / 2
        group[axis].attrs["units"] = "pixel"
    group["theta_deg"] = np.degrees(reconstruction.theta)
    group["axis_px"] = reconstruction.axis
    group["slices"].attrs["units"] = "attenuation per pixel"
    group["theta_deg"].attrs["units"] = "deg"
    group["axis_px"].attrs["units"] = "pixel"
    attributes: Mapping[str, Any] = {
        "NX_class": "NXdata",
        "signal": "slices",
        "axes": np.array(["rows", "z", "x"], dtype=object),
        "interpretation": "image",
        "method": reconstruction.method,
    }
    group.attrs.update(attributes)


def write_tiffs(folder: Path, reconstructions: Reconstructions) -> list[Path]:
    """Write a stack ``<name>.tif`` for each reconstruction, a float32 page for each slice.

    Its description names the rows of the pages. A stack appears whole or not at all.

    Raises
    ------
    ScanError
        If the folder cannot be written to.
    """
    folder = Path(folder)
    written = []
    with translated(folder / "slices"):
        folder.mkdir(parents=True, exist_ok=True)
        for name, reconstruction in reconstructions.items():
            written.append(folder / f"{name}.tif")
            draft = folder / f".{name}.tif.tomoslam-new"
            try:
                _write_stack(draft, name, reconstruction)
                put_in_place(draft, written[-1])
            finally:
                discard(draft)
    return written


def _write_stack(path: Path, name: str, reconstruction: Reconstruction) -> None:
    from PIL import Image

    rows = ", ".join(str(row) for row in reconstruction.rows)
    said = f"{name} angles, {reconstruction.method}, attenuation per pixel; detector rows {rows}"
    first, *others = (Image.fromarray(np.asarray(s, np.float32)) for s in reconstruction.slices)
    # Readers of all sorts know the small format, which ends at 4 GB.
    large = reconstruction.slices.nbytes > LARGEST_TIFF
    more: dict[str, Any] = {"append_images": others, "save_all": True, "big_tiff": large}
    first.save(path, format="TIFF", description=said, **more)
