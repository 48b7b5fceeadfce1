"""What a scan must be before any work begins: one check, one message.

A new check is a function of `Contents` that raises, and one line in `CHECKS`. Those of the angles
come last, as they need datasets that have passed the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.dxchange import DARKS, DATA, FLATS
from tomoslam_stage.scans.theta import decide_units, to_radians

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tomoslam_stage.products import Floats
    from tomoslam_stage.scans.dxchange import Contents, DatasetFacts
    from tomoslam_stage.scans.theta import Units

MIN_PROJECTIONS = 3
MIN_COLUMNS = 8
MIN_SPAN_DEG = 10.0


def check(contents: Contents, *, parallel: bool) -> None:
    """Raise the first thing that is wrong with the datasets and the beam.

    Raises
    ------
    ScanError
        With what was found and what was needed.
    """
    for one in CHECKS:
        one(contents)
    if not parallel:
        check_beam(contents)


def problems(contents: Contents) -> Iterator[str]:
    """Say everything that is wrong, as far as it can be told."""
    for one in (*CHECKS, check_beam):
        try:
            one(contents)
        except ScanError as error:
            yield str(error)
            if one in (check_present, check_data):  # the rest rely on these
                return


def check_present(contents: Contents) -> None:
    """Check that projections and angles are there."""
    for key in (DATA, contents.angles_from):
        if key in contents.absent:
            raise ScanError(
                contents.path.name,
                f"{key} {contents.absent[key]}.",
                "A DXchange file with /exchange/data and /exchange/theta is needed.",
            )


def check_readable(contents: Contents) -> None:
    """Check that every filter is installed, and every file behind a dataset is there."""
    for key, facts in contents.datasets.items():
        if facts.missing_filters:
            raise ScanError(
                contents.path.name,
                f"{key} is compressed with {', '.join(facts.missing_filters)}, "
                "which is not installed.",
                "Install the package hdf5plugin.",
            )
        if facts.missing_files:
            raise ScanError(
                contents.path.name,
                f"{key} draws on {', '.join(facts.missing_files)}, which is missing.",
                "Put it back beside the scan.",
            )


def check_data(contents: Contents) -> None:
    """Check that the projections are a stack of real numbers, large enough to work on."""
    facts, name = contents.datasets[DATA], contents.path.name
    if len(facts.shape) != 3:
        raise ScanError(
            name,
            f"{DATA} has {len(facts.shape)} dimensions {facts.shape}; "
            "three (projection, row, column) are needed.",
        )
    _check_real(contents, DATA)
    n, rows, columns = facts.shape
    if n < MIN_PROJECTIONS or rows < 1 or columns < MIN_COLUMNS:
        raise ScanError(
            name,
            f"{DATA} holds {n} projections of {rows} x {columns} px; at least "
            f"{MIN_PROJECTIONS} of 1 x {MIN_COLUMNS} px are needed.",
        )


def _check_real(contents: Contents, key: str) -> None:
    dtype = contents.datasets[key].dtype
    if dtype.kind not in "iuf":
        kind = "complex numbers" if dtype.kind == "c" else f"values of type {dtype}"
        raise ScanError(
            contents.path.name,
            f"{key} holds {kind}; integers or real numbers are needed.",
            "Store the intensity or the line integrals." if dtype.kind == "c" else "",
        )


def check_references(contents: Contents) -> None:
    """Check that flats and darks fit the detector of the projections."""
    for key in (FLATS, DARKS):
        if key in contents.datasets:
            _check_detector(contents, key)


def _check_detector(contents: Contents, key: str) -> None:
    facts, detector = contents.datasets[key], contents.datasets[DATA].shape[1:]
    if len(facts.shape) not in (2, 3) or facts.shape[-2:] != detector:
        raise ScanError(
            contents.path.name,
            f"{key} has the shape {facts.shape}; frames of {detector[0]} x {detector[1]} px, "
            f"as in {DATA}, are needed.",
        )
    _check_real(contents, key)


def check_angles(contents: Contents) -> None:
    """Check that there is one finite number for each projection."""
    angles, name, key = contents.angles, contents.path.name, contents.angles_from
    n = contents.datasets[DATA].shape[0]
    if angles is None or angles.dtype.kind not in "iuf":
        dtype = None if angles is None else angles.dtype
        raise ScanError(name, f"{key} holds values of type {dtype}; numbers are needed.")
    if angles.ndim != 1:
        raise ScanError(name, f"{key} has the shape {angles.shape}; one dimension is needed.")
    if len(angles) != n:
        raise ScanError(
            name,
            f"{key} holds {len(angles)} angles for {n} projections in {DATA}; "
            "one per projection is needed.",
            "Find the missing or extra frame, and repair theta.",
        )
    if not np.isfinite(angles).all():
        bad = np.flatnonzero(~np.isfinite(angles))
        raise ScanError(
            name,
            f"{key} holds {len(bad)} angles that are NaN or infinite, the first at frame "
            f"{bad[0]}; finite angles are needed.",
            "Repair theta.",
        )


def check_beam(contents: Contents) -> None:
    """Check that the beam is parallel as far as this detector can tell."""
    why = contents.beam.why_divergent(contents.datasets[DATA].shape[-1])
    if why is not None:
        raise ScanError(
            contents.path.name,
            f"a cone beam: {why}; a parallel beam is needed.",
            "Pass --parallel if the projections are parallel nevertheless.",
        )


CHECKS: tuple[Callable[[Contents], None], ...] = (
    check_present,
    check_readable,
    check_data,
    check_references,
    check_angles,
)


def recorded_angles(contents: Contents, asked: Units) -> Floats:
    """Return the recorded angles (n,) in unwrapped radians, or say why they cannot be used.

    Raises
    ------
    ScanError
        For angles that stand still, repeat, or span too short an arc, and for unknown units.
    """
    name = contents.path.name
    stored = np.asarray(contents.angles, np.float64)
    unit = decide_units(stored, contents.units, asked, name)
    theta = to_radians(stored, unit)
    check_moves(theta, name)
    return theta


def check_moves(theta: Floats, name: str) -> None:
    """Check that the stage turns: no angle twice, and an arc long enough to see it.

    Parameters
    ----------
    theta
        (n,) radians, unwrapped; a full turn apart is not the same angle.
    name
        What messages call the scan.

    Raises
    ------
    ScanError
        If it does not.
    """
    degrees = np.degrees(theta)
    span = float(np.ptp(degrees))
    if span == 0:
        raise ScanError(
            name,
            f"all {len(theta)} angles are {degrees[0]:.6g} degrees; a turning stage is needed.",
            "Restore theta from the planned angles.",
        )
    values, first, counts = np.unique(degrees, return_index=True, return_counts=True)
    if (counts > 1).any():
        again = int(np.argmax(counts > 1))
        raise ScanError(
            name,
            f"{(counts > 1).sum()} angles occur more than once, the first ({values[again]:.6g} "
            f"degrees, {counts[again]} times) at frame {first[again]}; each angle once is needed.",
            "Average or drop repeated frames, or repair theta.",
        )
    if span < MIN_SPAN_DEG:
        raise ScanError(
            name,
            f"theta spans {span:.4g} degrees; at least {MIN_SPAN_DEG:g} are needed.",
            "If it holds radians, pass --set load_scan.units=rad.",
        )


def frames_in(facts: DatasetFacts | None) -> int:
    """Count the frames of flats or darks; a single one may be stored without its own axis."""
    if facts is None:
        return 0
    return facts.shape[0] if len(facts.shape) == 3 else 1
