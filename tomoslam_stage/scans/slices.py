"""Reconstructed slices as files: one HDF5 file, or one TIFF for each slice."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.scans.fresh import fresh_file, translated

if TYPE_CHECKING:
    from collections.abc import Mapping

    from h5py import File

    from tomoslam_stage.products import Reconstruction, Reconstructions


def write_slices(path: Path, reconstructions: Reconstructions) -> None:
    """Write all slices into one HDF5 file that viewers of NeXus files (silx) plot when opened.

    One group for each reconstruction: ``slices`` (row, z, x) in float32, ``rows``,
    ``theta_deg``, ``axis_px``.

    Raises
    ------
    ScanError
        If the file cannot be written; an earlier one is then still there.
    """
    with fresh_file(Path(path).resolve()) as file:
        file.attrs["NX_class"] = "NXroot"
        for name, reconstruction in reconstructions.items():
            _write_group(file, name, reconstruction)
        if reconstructions:
            file.attrs["default"] = "refined" if "refined" in file else next(iter(reconstructions))


def _write_group(file: File, name: str, reconstruction: Reconstruction) -> None:
    group = file.create_group(name)
    group["slices"] = np.asarray(reconstruction.slices, np.float32)
    group["rows"] = reconstruction.rows
    group["theta_deg"] = np.degrees(reconstruction.theta)
    group["axis_px"] = reconstruction.axis
    group["slices"].attrs["units"] = "attenuation per pixel"
    group["theta_deg"].attrs["units"] = "deg"
    group["axis_px"].attrs["units"] = "pixel"
    attributes: Mapping[str, Any] = {
        "NX_class": "NXdata",
        "signal": "slices",
        "axes": np.array(["rows", ".", "."], dtype=object),
        "interpretation": "image",
        "method": reconstruction.method,
    }
    group.attrs.update(attributes)


def write_tiffs(folder: Path, reconstructions: Reconstructions) -> list[Path]:
    """Write each slice as float32 TIFF, ``<name>_row<row>.tif``, and return the files.

    Raises
    ------
    ScanError
        If the folder cannot be written to.
    """
    from PIL import Image

    folder = Path(folder)
    written = []
    with translated(folder / "slices"):
        folder.mkdir(parents=True, exist_ok=True)
        for name, reconstruction in reconstructions.items():
            for row, one in zip(reconstruction.rows, reconstruction.slices, strict=True):
                written.append(folder / f"{name}_row{row:05d}.tif")
                Image.fromarray(np.asarray(one, np.float32)).save(written[-1])
    return written
