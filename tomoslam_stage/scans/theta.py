"""From stored angles to radians: their unit, and the turns a modulo took away."""

from __future__ import annotations

import logging
from typing import Literal, TypeAlias, get_args

import numpy as np

from tomoslam_stage.errors import ScanError, nearest
from tomoslam_stage.products import Floats

Units: TypeAlias = Literal["auto", "deg", "rad"]

log = logging.getLogger("tomoslam_stage")

DEGREES = ("deg", "degs", "degree", "degrees", "°")
RADIANS = ("rad", "rads", "radian", "radians")

RADIAN_SPAN = (2.5, 6.5)
"""Spans that are a scan of half to one turn in radians, but hardly any scan in degrees."""
MOST_TURNS_RAD = 14
"""A scan of a quarter of a turn, its degrees called radians, spans this many."""
STEADY_STEP_DEG = 90.0
"""A stage that moves on by less than this from projection to projection goes steadily."""


def decide_units(angles: Floats, stored: str | None, asked: Units, where: str) -> str:
    """Return ``deg`` or ``rad``: what was asked for, else what the file says, else a guess.

    Raises
    ------
    ScanError
        If the file names a unit that is not an angle.
    """
    if asked not in get_args(Units):
        raise ScanError(where, f"no unit {asked!r} for theta.", nearest(asked, get_args(Units)))
    if asked != "auto":
        return asked
    if stored is None:
        return _guess(angles, where)
    unit = stored.strip().lower().rstrip(".")
    if unit in DEGREES:
        return "deg"
    if unit in RADIANS:
        _check_turns(angles, where)
        return "rad"
    raise ScanError(
        where,
        f"theta has the unit {stored!r}; degrees or radians are needed.",
        "Pass --set load_scan.units=deg (or rad).",
    )


def _check_turns(angles: Floats, where: str) -> None:
    """Refuse degrees that are called radians: a turn of 360 would be one of 57 turns."""
    turns = float(np.ptp(angles)) / (2 * np.pi)
    if turns > MOST_TURNS_RAD:
        raise ScanError(
            where,
            f"theta has the unit rad, in which it spans {turns:.4g} turns; "
            f"up to {MOST_TURNS_RAD} are believed unasked.",
            "Pass --set load_scan.units=deg if it holds degrees, or load_scan.units=rad.",
        )


def _guess(angles: Floats, where: str) -> str:
    span = float(np.ptp(angles))
    low, high = RADIAN_SPAN
    unit = "rad" if low <= span <= high else "deg"
    log.warning("%s: theta has no units; it spans %.4g, so it is taken as %s", where, span, unit)
    return unit


def to_radians(angles: Floats, unit: str) -> Floats:
    """Return unwrapped radians.

    Parameters
    ----------
    angles
        (n,) in `unit`, as stored.
    unit
        ``deg`` or ``rad``.
    """
    degrees = np.degrees(angles) if unit == "rad" else np.asarray(angles, np.float64)
    return np.radians(unwrapped(degrees))


def unwrapped(degrees: Floats) -> Floats:
    """Give back the turns to angles that were stored modulo 360.

    Only where the stage goes round steadily: interlaced and golden-angle scans jump by large
    steps, which are theirs and stay.
    """
    if np.ptp(degrees) > 360 or np.abs(np.diff(degrees)).max(initial=0) < 180:
        return degrees
    candidate = np.unwrap(degrees, period=360)
    steps = np.diff(candidate)
    steady = np.abs(steps).max() < STEADY_STEP_DEG and abs(steps.sum()) > np.abs(steps).sum() / 2
    return candidate if steady else degrees
