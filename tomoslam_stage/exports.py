"""The angles of a scan as files that other programs read.

To add a program, write a function that makes its files of `StoredAngles`, and a line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

from tomoslam_stage.comparison.plain import one_column
from tomoslam_stage.comparison.writing import write_atomically
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.scans import StoredAngles, read_angles

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats

Files: TypeAlias = Mapping[str, bytes]
"""End of the name -> what is in the file."""

TWO_NAMES = """\
# For one scan: flats and darks are read from the file named here, whatever HTTomo is run on.
# It has two names, as HTTomo 3.0 looks for both in one dataset where they come from one file.
"""


@dataclass(frozen=True)
class Format:
    """What one program reads."""

    make: Callable[[StoredAngles], Files]
    use: str
    """What to do with the file, in a line; ``{file}`` is its name, ``{scan}`` that of the scan."""


def text(angles: StoredAngles) -> Files:
    """Write one angle a line, degrees, with all digits."""
    return {".txt": one_column(angles.standing)}


def imod(angles: StoredAngles) -> Files:
    """Write those that stand as ``.tlt`` and the recorded ones as ``.rawtlt``, as IMOD has them."""
    return {".tlt": tilts(angles.standing), ".rawtlt": tilts(angles.recorded)}


def tilts(degrees: Floats) -> bytes:
    """Write one angle a line as IMOD does, but with as many digits as refining is worth."""
    return "".join(f"{angle:z11.5f}\n" for angle in degrees).encode()


def httomo(angles: StoredAngles) -> Files:
    """Write a pipeline for the processor alone; its loader knows where this scan has everything."""
    loader = _loader(angles)
    entries: list[dict[str, Any]] = [
        _entry("standard_tomo", "httomo.data.hdf.loaders", **loader),
        _entry("normalize", "tomopy.prep.normalize", cutoff=None, averaging="mean"),
        _entry("minus_log", "tomopy.prep.normalize"),
        {
            **_entry("find_center_vo", "tomopy.recon.rotation", ind="mid"),
            "id": "centering",
            "side_outputs": {"cor": "centre_of_rotation"},
        },
        _entry(
            "recon",
            "tomopy.recon.algorithm",
            center="${{centering.side_outputs.centre_of_rotation}}",
            sinogram_order=False,
            algorithm="gridrec",
            init_recon=None,
        ),
    ]
    said = yaml.safe_dump(entries, sort_keys=False, width=1000)
    return {".yaml": ((TWO_NAMES if "flats" in loader else "") + said).encode()}


def _entry(method: str, module_path: str, **parameters: Any) -> dict[str, Any]:
    return {"method": method, "module_path": module_path, "parameters": parameters}


def _loader(angles: StoredAngles) -> dict[str, Any]:
    contents, places = angles.contents, angles.contents.places
    loader: dict[str, Any] = {
        "data_path": places.data,
        "image_key_path": contents.labels.kinds_from or None if contents.layout.mixed else None,
        "rotation_angles": {"data_path": places.theta},
    }
    scan = contents.path.resolve()
    detour = scan.parent / ".." / scan.parent.name / scan.name
    for name, file, place in (("darks", scan, places.darks), ("flats", detour, places.flats)):
        if place in contents.datasets:
            loader[name] = {"file": str(file), "data_path": place}
    return loader


FORMATS: Mapping[str, Format] = {
    "text": Format(text, "one angle a line, degrees"),
    "nabu": Format(text, "nabu: set angles_file = {file} in the section [reconstruction]"),
    "imod": Format(imod, "IMOD: {file} takes the place of the scan's .tlt"),
    "httomo": Format(httomo, "HTTomo: httomo run {scan} {file} OUT"),
}
"""What ``export --format`` may name."""


def export(scan: Path, name: str, output: Path | None = None) -> dict[Path, str]:
    """Write the angles that stand in a scan for another program.

    Parameters
    ----------
    scan
        The file; it is only read.
    name
        A key of `FORMATS`.
    output
        The file to write; by default beside the scan, under its name. Where a format has two files,
        the second one has the same name and its own ending.

    Returns
    -------
    Each file written, and what to do with it.

    Raises
    ------
    PipelineError
        For an unknown format, or a file that cannot be written.
    ScanError
        If the scan has no angles to export.
    """
    if name not in FORMATS:
        raise PipelineError("--format", f"no format {name!r}.", nearest(name, FORMATS))
    made, written = FORMATS[name].make(read_angles(scan)), {}
    for i, (ending, content) in enumerate(made.items()):
        first = output or scan.with_name(f"{scan.stem}_{name}{ending}")
        path = first if i == 0 else first.with_suffix(ending)
        if path.exists() and path.samefile(scan):
            raise PipelineError("--output", f"{path} is the scan itself.", "Choose another file.")
        write_atomically(path, content)
        written[path] = (
            FORMATS[name].use.format(file=path, scan=scan) if i == 0 else "the recorded angles"
        )
    return written
