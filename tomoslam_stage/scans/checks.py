"""What a scan must be before any work begins: one check, one message.

A new check is a function of `Contents` that raises, and one line in `CHECKS`. Those of the angles
come last, as they need datasets that have passed the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.pairing import spans
from tomoslam_stage.scans.theta import decide_units, to_radians

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tomoslam_stage.products import Floats, Integers
    from tomoslam_stage.scans.contents import Contents
    from tomoslam_stage.scans.theta import Units

MIN_PROJECTIONS = 3
MIN_COLUMNS = 8
MIN_SPAN_DEG = 10.0
KINDS = {
    "c": "complex numbers",
    "O": "texts or lists",
    "S": "texts",
    "V": "records",
    "b": "truth values",
}
"""What messages call values that are no numbers, by the kind of their numpy type."""
MOST_NAMED = 60
"""Characters of a list of frames in a message."""


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
    for key in (contents.places.data, contents.angles_from):
        if key in contents.absent:
            raise ScanError(
                contents.path.name,
                f"{key} {contents.absent[key]}.",
                "A DXchange file with /exchange/data and /exchange/theta, or an NXtomo entry, is "
                "needed.",
            )


def check_readable(contents: Contents) -> None:
    """Check that every filter is installed, and every file behind a dataset is there."""
    for key, facts in contents.datasets.items():
        if facts.unreadable is not None:
            found, remedy = facts.unreadable
            raise ScanError(contents.path.name, f"{key} {found}", remedy)


def check_data(contents: Contents) -> None:
    """Check that the projections are a stack of real numbers, large enough to work on."""
    facts, name, data = contents.data, contents.path.name, contents.places.data
    if len(facts.shape) != 3:
        raise ScanError(
            name,
            f"{data} has {len(facts.shape)} dimensions {facts.shape}; "
            "three (projection, row, column) are needed.",
        )
    _check_real(contents, data)
    rows, columns = facts.shape[1:]
    n = len(contents.frames)
    if n < MIN_PROJECTIONS or rows < 1 or columns < MIN_COLUMNS:
        raise ScanError(
            name,
            f"{data} holds {n} projections of {rows} x {columns} px; at least "
            f"{MIN_PROJECTIONS} of 1 x {MIN_COLUMNS} px are needed.",
        )


def _check_real(contents: Contents, key: str) -> None:
    dtype = contents.datasets[key].dtype
    if dtype.kind not in "iuf":
        raise ScanError(
            contents.path.name,
            f"{key} holds {_called(dtype)}; integers or real numbers are needed.",
            "Store the intensity or the line integrals." if dtype.kind == "c" else "",
        )


def _called(dtype: np.dtype[Any]) -> str:
    return KINDS.get(dtype.kind, f"values of type {dtype}")


def check_references(contents: Contents) -> None:
    """Check that flats and darks fit the detector of the projections."""
    if contents.wrong is not None:
        raise ScanError(contents.path.name, *contents.wrong)
    for key in filter(None, (contents.places.flats, contents.places.darks)):
        if key in contents.datasets:
            _check_detector(contents, key)
        elif contents.absent[key] != "is missing":  # going without would be another measurement
            found = f"{key} {contents.absent[key]}."
            raise ScanError(contents.path.name, found, "Mend it, or remove it from the file.")


def _check_detector(contents: Contents, key: str) -> None:
    facts, detector = contents.datasets[key], contents.data.shape[1:]
    if len(facts.shape) not in (2, 3) or facts.shape[-2:] != detector:
        raise ScanError(
            contents.path.name,
            f"{key} has the shape {facts.shape}; frames of {detector[0]} x {detector[1]} px, "
            f"as in {contents.places.data}, are needed.",
        )
    _check_real(contents, key)


def check_angles(contents: Contents) -> None:
    """Check that the angles are a list of numbers."""
    angles, name, key = contents.angles, contents.path.name, contents.angles_from
    if angles is None or angles.dtype.kind not in "iuf":
        held = "nothing that can be read" if angles is None else _called(angles.dtype)
        raise ScanError(name, f"{key} holds {held}; real numbers are needed.")
    if angles.ndim != 1:
        raise ScanError(name, f"{key} has the shape {angles.shape}; one dimension is needed.")


def check_beam(contents: Contents) -> None:
    """Check that the beam is parallel as far as this detector can tell."""
    why = contents.beam.why_divergent(contents.data.shape[-1])
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
    """Return the recorded angles (a,) in unwrapped radians; what is no number stays none.

    Raises
    ------
    ScanError
        For unknown units, or where there is no number at all.
    """
    name = contents.path.name
    stored = np.asarray(contents.angles, np.float64)
    finite = np.isfinite(stored)
    if len(stored) == contents.data.shape[0]:
        finite[contents.besides] = False  # where the stage stood for a flat does not matter
    if not finite.any():
        found = f"{contents.angles_from} holds no finite angle of {len(stored)}."
        raise ScanError(name, found, "Restore theta from the planned angles.")
    unit = decide_units(stored[finite], contents.units, asked, name)
    theta = np.full(len(stored), np.nan)
    theta[finite] = to_radians(stored[finite], unit)
    return theta


def check_moves(theta: Floats, frames: Integers, contents: Contents) -> None:
    """Check that the stage turns: finite angles, none twice, an arc long enough to see it.

    Parameters
    ----------
    theta
        (n,) radians, unwrapped; a full turn apart is not the same angle.
    frames
        (n,) where they are in the file.
    contents
        What is in the file, for messages.

    Raises
    ------
    ScanError
        If it does not.
    """
    name, degrees = contents.path.name, np.degrees(theta)
    bad = frames[~np.isfinite(degrees)]
    if len(bad):
        raise ScanError(
            name,
            f"{contents.angles_from} holds {len(bad)} angles that are NaN or infinite, the first "
            f"at frame {bad[0]}; finite angles are needed.",
            f"Repair theta{_or_drop(bad)}.",
        )
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
        repeats = np.setdiff1d(frames, frames[first])
        raise ScanError(
            name,
            f"{(counts > 1).sum()} angles occur more than once, the first ({values[again]:.6g} "
            f"degrees, {counts[again]} times) at frame {frames[first[again]]}; each angle once "
            "is needed.",
            f"Average repeated frames, or repair theta{_or_drop(repeats)}.",
        )
    if span < MIN_SPAN_DEG:
        raise ScanError(
            name,
            f"theta spans {span:.4g} degrees; at least {MIN_SPAN_DEG:g} are needed.",
            "If it holds radians, pass --set load_scan.units=rad.",
        )


def _or_drop(frames: Integers) -> str:
    """Name the option that leaves `frames` out, unless there are too many to be read."""
    named = spans(frames)
    return f", or pass --drop-frames {named}" if len(named) <= MOST_NAMED else ""
