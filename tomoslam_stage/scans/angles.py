"""The angles of the projections in a file, as other programs want them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.checks import check_angles, check_present, recorded_angles
from tomoslam_stage.scans.contents import in_degrees
from tomoslam_stage.scans.files import open_file
from tomoslam_stage.scans.layouts import read_contents
from tomoslam_stage.scans.transaction import recover

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats
    from tomoslam_stage.scans.contents import Contents


class StoredAngles(NamedTuple):
    """What a file says about the angles of its projections."""

    standing: Floats
    """(n,) degrees: the refined ones where there are some."""
    recorded: Floats
    """(n,) degrees."""
    contents: Contents


def read_angles(path: Path | str) -> StoredAngles:
    """Read the angles of all frames that are projections; no pixel is looked at.

    Raises
    ------
    ScanError
        If the file is no scan, or an angle is missing.
    """
    path = Path(path)
    recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        check_present(contents)
        check_angles(contents)
        places, frames = contents.places, projections_of(contents)
        stored = np.asarray(contents.angles, np.float64)
        if contents.refined:
            standing = np.asarray(file[places.theta][()], np.float64)
            if stored.shape == standing.shape:
                stored = in_degrees(stored, standing, frames)
        else:
            standing = stored = np.degrees(recorded_angles(contents, "auto"))
    n = contents.data.shape[0]
    if standing.shape != (n,) or not np.isfinite(standing[frames]).all():
        found = f"{places.theta} has no finite angle for each of {len(frames)} projections."
        raise ScanError(path.name, found, "Refine the scan first: run inspect on it to see why.")
    recorded = stored[frames] if stored.shape == (n,) else stored
    return StoredAngles(standing[frames], recorded, contents)


def projections_of(contents: Contents) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """(n,) frames that other programs take for projections: those the file calls so."""
    n, labels = contents.data.shape[0], contents.labels
    if not contents.layout.mixed or len(labels.kinds) != n:
        return np.arange(n)
    return np.flatnonzero(labels.are("projection"))


def find_paths(path: Path) -> dict[str, list[str]]:
    """By key of HTTomo's loader: the paths in a file that mean what the loader wants there.

    Raises
    ------
    ScanError
        If the file cannot be read.
    """
    recover(path)
    with open_file(path) as file:
        contents = read_contents(file, path)
        places, layout = contents.places, contents.layout
        return {
            "data_path": [places.data, *layout.aliases(file, places.data)],
            "image_key_path": [contents.labels.kinds_from] if layout.mixed else [],
            "rotation_angles": [places.theta, *layout.aliases(file, places.theta)],
            "darks.data_path": [places.darks] if places.darks else [],
            "flats.data_path": [places.flats] if places.flats else [],
        }
