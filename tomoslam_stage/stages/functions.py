"""The stages as plain functions, for scripts: arrays in, arrays out, no pipeline.

Parameters by keyword are those that a pipeline gives the stage of the same name:
``refine_theta(projections, theta, tracks={"detector": "surf"})``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage import comparison, scans
from tomoslam_stage.methods import checked
from tomoslam_stage.products import Reconstruction
from tomoslam_stage.stages.loading import LoadScan
from tomoslam_stage.stages.reconstructing import Reconstruct
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Clock

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tomoslam_stage.products import Comparison, Floats, Pixels, Refinement


def load_scan(path: Path | str, **parameters: Any) -> tuple[scans.Stack, Floats]:
    """Open a DXchange scan.

    Parameters
    ----------
    path
        The file; it is only read.
    parameters
        Those of the stage ``load_scan``: ``kind``, ``units``, ``parallel``, ``binning``.

    Returns
    -------
    projections
        (n, row, column) line integrals, float32; read from the file where they are sliced.
    theta
        (n,) radians, unwrapped: the recorded angles.

    Raises
    ------
    PipelineError
        For an unknown parameter, or a value that does not fit.
    ScanError
        If the scan cannot be used.
    """
    scan = checked(LoadScan, parameters, "load_scan").opened(Path(path))
    return scans.Stack(scan.source), scan.theta


def refine_theta(projections: Any, theta: ArrayLike, **parameters: Any) -> Refinement:
    """Refine the rotation angles of projections in memory, or in an open HDF5 dataset.

    Parameters
    ----------
    projections
        (n, row, column) line integrals, minus-log and flat-fielded; read in blocks.
    theta
        (n,) radians: the recorded angles.
    parameters
        Those of the stage ``refine_theta``: ``tracks={"detector": "surf"}``.

    Returns
    -------
    `Refinement`: its ``theta`` (n,) are the angles that stand, in radians; ``sigma`` (n,) one
    standard deviation of the refined ones; ``axis`` the detector column of the rotation axis, px;
    ``status`` and ``reason`` the verdict.

    Raises
    ------
    PipelineError
        For an unknown parameter, or a value that does not fit.
    ScanError
        If the shapes do not fit each other.
    """
    scan = scans.scan_of(projections, np.asarray(theta, np.float64))
    return checked(RefineTheta, parameters, "refine_theta").refine(scan, Clock({}))


def reconstruct(projections: Any, theta: ArrayLike, axis: float, **parameters: Any) -> Pixels:
    """Reconstruct slices.

    Parameters
    ----------
    projections
        (n, row, column) line integrals.
    theta
        (n,) radians.
    axis
        Detector column of the rotation axis, px.
    parameters
        Those of the stage ``reconstruct``: ``algorithm="sirt"``, ``rows=[10, 20]`` (by default
        three rows, spread over the object), ``backend="embedded"``.

    Returns
    -------
    (r, z, x) attenuation per pixel, float32; the middle ``(n - 1) / 2`` lies on the axis.

    Raises
    ------
    BackendMissingError
        If nothing that is installed can do it.
    PipelineError
        For an unknown parameter, or a value that does not fit.
    ScanError
        If the shapes do not fit each other.
    """
    scan = scans.scan_of(projections, np.asarray(theta, np.float64))
    return checked(Reconstruct, parameters, "reconstruct").alone(scan, axis)


def compare(recorded: ArrayLike, refined: ArrayLike, true: ArrayLike | None = None) -> Comparison:
    """Compare slices of the same rows from recorded, from refined and perhaps from true angles.

    Parameters
    ----------
    recorded, refined, true
        (r, z, x) attenuation per pixel.

    Returns
    -------
    `Comparison`: its ``sharpness``, ``similarity`` (to the true ones) and ``edge_width_px``. They
    describe and do not judge: that is for the rows that `refine_theta` left out.

    Raises
    ------
    ValueError
        If the slices are not of the same shape.
    """
    given = {"recorded": recorded, "refined": refined, "true": true}
    slices = {n: np.asarray(s, np.float32) for n, s in given.items() if s is not None}
    return comparison.compare_slices(
        {
            name: Reconstruction(np.empty(0), np.nan, np.arange(len(each)), each, "given")
            for name, each in slices.items()
        }
    )


def write_theta(
    path: Path | str, theta: ArrayLike, sigma: ArrayLike | None = None, output: Path | None = None
) -> None:
    """Write angles into a scan, in one transaction; its recorded angles are kept beside them.

    Parameters
    ----------
    path
        The scan.
    theta
        (n,) radians, one for each projection.
    sigma
        (n,) radians, one standard deviation; NaN where not given.
    output
        A companion file that gets the angles instead; the scan is only read then.

    Raises
    ------
    ScanError
        If the lengths do not fit, or nothing can be written; the scan is then as it was.
    """
    angles = np.asarray(theta, np.float64)
    spread = np.full(angles.shape, np.nan) if sigma is None else np.asarray(sigma, np.float64)
    versions = {name: version or "" for name, version in comparison.versions().items()}
    record = scans.ProcessRecord(versions=versions, message="theta given by a script")
    if output is None:
        scans.write_theta(Path(path), angles, spread, record)
    else:
        scans.write_companion(Path(output), Path(path), angles, spread, record)
