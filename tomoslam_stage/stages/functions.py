"""The stages as plain functions, for scripts: arrays in, arrays out, no pipeline.

Parameters by keyword are those that a pipeline gives the stage of the same name:
``refine_theta(projections, theta, tracks={"detector": "surf"})``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage import comparison, scans
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.methods import checked
from tomoslam_stage.stages.loading import LoadScan
from tomoslam_stage.stages.reconstructing import Reconstruct
from tomoslam_stage.stages.refining import RefineTheta
from tomoslam_stage.stages.work import Clock
from tomoslam_stage.stages.writing import WriteTheta

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tomoslam_stage.products import Floats, Pixels, Refinement


def load_scan(path: Path | str, **parameters: Any) -> tuple[scans.Stack, Floats]:
    """Open a DXchange or NXtomo scan.

    Parameters
    ----------
    path
        The file; it is only read.
    parameters
        Those of the stage ``load_scan``: ``kind``, ``units``, ``parallel``, ``binning``,
        ``drop_frames``, ``keep_frames``, ``drop_angles``.

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

    Examples
    --------
    >>> projections, theta = load_scan(SCAN)
    >>> projections.shape, len(theta)
    ((240, 112, 208), 240)
    >>> projections[10, 56:58].dtype
    dtype('float32')
    """
    scan = checked(LoadScan, parameters, "load_scan").opened(Path(path))
    return scans.Stack(scan.source, scan), scan.theta


def refine_theta(projections: Any, theta: ArrayLike, **parameters: Any) -> Refinement:
    """Refine the rotation angles of projections in memory, in an HDF5 dataset or a dask array.

    Parameters
    ----------
    projections
        (n, row, column) line integrals, minus-log and flat-fielded; anything with a ``shape`` and
        slices will do, and is read in blocks.
    theta
        (n,) radians: the recorded angles.
    parameters
        Those of the stage ``refine_theta``: ``tracks={"detector": "surf"}``.

    Returns
    -------
    `Refinement`, which a notebook shows as a table and a curve: its ``theta`` (n,) are the angles
    that stand, in radians; ``sigma`` (n,) one standard deviation of the refined ones; ``axis`` the
    detector column of the rotation axis, px; ``status`` and ``reason`` the verdict; ``shift`` (n,)
    the column shifts of the projections, px, where they were unknown.

    Raises
    ------
    PipelineError
        For an unknown parameter, or a value that does not fit.
    ScanError
        If the shapes do not fit each other, or the angles are no radians.

    Examples
    --------
    >>> projections, theta = load_scan(SCAN)
    >>> part, angles = projections[::2, 32:80], theta[::2]  # to be done in seconds
    >>> refinement = refine_theta(part, angles, mapping=None, rounds=2)
    >>> refinement.status, refinement.theta.shape
    ('accepted', (120,))
    """
    scan = scans.scan_of(projections, np.asarray(theta, np.float64))
    return checked(RefineTheta, parameters, "refine_theta").refine(scan, Clock({}))


def reconstruct(
    projections: Any,
    theta: ArrayLike,
    axis: float,
    shift: ArrayLike | None = None,
    **parameters: Any,
) -> Pixels:
    """Reconstruct slices.

    Parameters
    ----------
    projections
        (n, row, column) line integrals.
    theta
        (n,) radians.
    axis
        Detector column of the rotation axis, px.
    shift
        (n,) px that each projection lies to the right; by default none does.
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
        If the shapes do not fit each other, or the angles are no radians.

    Examples
    --------
    >>> projections, theta = load_scan(SCAN)
    >>> reconstruct(projections, theta, 103.5, rows=[56], backend="embedded").shape
    (1, 208, 208)
    """
    scan = scans.scan_of(projections, np.asarray(theta, np.float64))
    shifts = _of_each(shift, scan.n_projections, "reconstruct.shift")
    return checked(Reconstruct, parameters, "reconstruct").alone(scan, axis, shifts)


def compare(
    recorded: ArrayLike, refined: ArrayLike, true: ArrayLike | None = None
) -> comparison.Compared:
    """Compare slices of the same rows from recorded, from refined and perhaps from true angles.

    Parameters
    ----------
    recorded, refined, true
        (r, z, x) attenuation per pixel.

    Returns
    -------
    `Compared`: its ``sharpness``, ``similarity`` (to the true ones) and ``edge_width_px`` describe
    and do not judge, which is for the rows that `refine_theta` left out; its ``figures()`` are
    matplotlib figures, one for each slice.

    Raises
    ------
    ValueError
        If the slices are not of the same shape.

    Examples
    --------
    >>> projections, theta = load_scan(SCAN)
    >>> before = reconstruct(projections, theta, 103.5, rows=[56], backend="embedded")
    >>> after = reconstruct(projections, theta + 0.01, 104.0, rows=[56], backend="embedded")
    >>> found = compare(before, after)
    >>> sorted(found.edge_width_px)
    ['recorded', 'refined']
    >>> [figure] = found.figures()
    """
    given = {"recorded": recorded, "refined": refined, "true": true}
    return comparison.compared(
        {name: np.asarray(each, np.float32) for name, each in given.items() if each is not None}
    )


def write_theta(
    path: Path | str,
    theta: ArrayLike,
    sigma: ArrayLike | None = None,
    output: Path | None = None,
    shift: ArrayLike | None = None,
    **parameters: Any,
) -> None:
    """Write angles into a scan, in one transaction; its recorded angles are kept beside them.

    Parameters
    ----------
    path
        The scan.
    theta
        (n,) radians, one for each frame in the file: `load_scan`'s projections know how to give
        one to frames that were left out (`Stack.for_every_frame`).
    sigma
        (n,) radians, one standard deviation; NaN where not given.
    output
        A companion file that gets the angles instead; the scan is only read then.
    shift
        (n,) px of the detector that each frame lies to the right, NaN where nobody knows: noted
        beside the parameters, for whoever reconstructs (`Stack.shift_for_every_frame`).
    parameters
        Those of the stage ``write_theta``: ``safe_copy``.

    Raises
    ------
    PipelineError
        If there is not one shift for each angle, or for an unknown parameter.
    ScanError
        If the lengths do not fit, or nothing can be written; the scan is then as it was.

    Examples
    --------
    >>> projections, theta = load_scan(SCAN)
    >>> write_theta(SCAN, theta + 0.001, output=COMPANION)
    >>> load_scan(COMPANION)[0].shape
    (240, 112, 208)
    """
    how = checked(WriteTheta, parameters, "write_theta")
    angles = np.asarray(theta, np.float64)
    spread = np.full(angles.shape, np.nan) if sigma is None else np.asarray(sigma, np.float64)
    versions = {name: version or "" for name, version in comparison.versions().items()}
    record = scans.ProcessRecord(
        versions=versions,
        message="theta given by a script",
        shift_px=_of_each(shift, angles.size, "write_theta.shift", some=True),
    )
    if output is None:
        scans.write_theta(Path(path), angles, spread, record, safe_copy=how.safe_copy)
    else:
        scans.write_companion(Path(output), Path(path), angles, spread, record)


def _of_each(values: ArrayLike | None, n: int, where: str, *, some: bool = False) -> Floats | None:
    """(n,) `values` as numbers, where only `some` need be known NaN too; None for none at all."""
    if values is None:
        return None
    each = np.asarray(values, np.float64)
    if each.shape != (n,) or not (np.isfinite(each) | (some & np.isnan(each))).all():
        found = f"values of shape {each.shape}; {n} finite ones are needed, one a projection."
        raise PipelineError(where, found)
    return each
