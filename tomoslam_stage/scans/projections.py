"""From the frames of a file to the projections of a scan, each with its angle."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.heldout import textured
from tomoslam_stage.products import Scan
from tomoslam_stage.scans.bad_frames import bad_frames, survey
from tomoslam_stage.scans.checks import MIN_PROJECTIONS, check_moves
from tomoslam_stage.scans.mismatch import ROWS, Series, finding
from tomoslam_stage.scans.pairing import Choice, paired, skipped, spans

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers
    from tomoslam_stage.scans.contents import Contents
    from tomoslam_stage.scans.sources import ConvertedSource

log = logging.getLogger("tomoslam_stage")

MOST_BAD = 1 / 3
"""Share of the frames; with more of them bad the others are no scan."""
USUAL_STEP = 1.5
"""Median steps: a recorded step this long does not allow for a frame that was skipped."""


@dataclass(frozen=True)
class Projections:
    """What is used of a file."""

    frames: Integers
    """(n,) their numbers in the file."""
    theta_of_frames: Floats
    """(m,) radians: the recorded angle of every frame, NaN where it has none."""
    left_out: Mapping[int, str]
    """Frame that is not used -> why."""


def projections(
    contents: Contents, theta: Floats, frames: ConvertedSource, choice: Choice
) -> Projections:
    """Give each frame its angle, and leave out those that are bad or not wanted.

    Parameters
    ----------
    contents
        What is in the file.
    theta
        (a,) radians, as recorded; not finite where the file holds no number.
    frames
        Line integrals of all frames, from what is stored.
    choice
        What the user says about them.

    Raises
    ------
    PipelineError
        For frames or angles that are named and not there.
    ScanError
        If there is not one usable angle for each frame, or too few frames are left.
    """
    name, n_frames = contents.path.name, frames.shape[0]
    pairing = paired((n_frames, len(theta)), contents.labels, choice)
    bad = {} if choice.keep_frames else _bad(contents, frames)
    if len(bad) > MOST_BAD * len(contents.frames):
        raise ScanError(name, *_too_many(bad, len(contents.frames)))
    if pairing is None:
        raise ScanError(name, *_mismatch(contents, theta, frames, bad))
    pairing = pairing.without(bad)
    left_out = {k: why for k, why in pairing.left_out.items() if k not in set(contents.besides)}
    _log_left_out(left_out, name)
    _warn_of_skipped(contents, theta)
    of_frames = np.where(pairing.angle >= 0, theta[pairing.angle], np.nan)
    if len(pairing.frames) < MIN_PROJECTIONS:
        found = f"{len(pairing.frames)} frames are left; {MIN_PROJECTIONS} or more are needed."
        raise ScanError(name, found, "Pass other --keep-frames or --drop-frames.")
    check_moves(of_frames[pairing.frames], pairing.frames, contents)
    return Projections(pairing.frames, of_frames, left_out)


def _bad(contents: Contents, frames: ConvertedSource) -> Mapping[int, str]:
    """Frame -> what is wrong with it; flats and darks are not asked."""
    some = contents.frames
    return {int(some[i]): why for i, why in bad_frames(survey(frames.only(some))).items()}


def _too_many(bad: Mapping[int, str], n_frames: int) -> tuple[str, str]:
    first = next(iter(bad))
    found = (
        f"{len(bad)} of {n_frames} frames are bad, the first of them {first} ({bad[first]}); "
        "two thirds of sound frames are needed."
    )
    return found, "Pass --keep-frames with those that are sound."


def _mismatch(
    contents: Contents, theta: Floats, frames: ConvertedSource, bad: Mapping[int, str]
) -> tuple[str, str]:
    """Say that there is not one angle for each frame, and what the images show about it."""
    n_frames = frames.shape[0]
    found = (
        f"{contents.angles_from} holds {len(theta)} angles for {n_frames} "
        f"{'frames' if contents.layout.mixed else 'projections'} in {contents.places.data}; "
        f"one per {'frame' if contents.layout.mixed else 'projection'} is needed."
    )
    if not np.isfinite(theta).all():
        return found, "Repair theta, which is not all finite either."
    if contents.layout.mixed:  # there would be flats and darks among what is compared
        return found, "Repair the angles, or the key that tells frames apart."
    good = np.setdiff1d(np.arange(n_frames), list(bad))
    sinograms = frames.read(good, _telling_rows(frames)).transpose(1, 0, 2)
    shown, remedy = finding(Series(sinograms, good, n_frames, theta))
    return f"{found} {shown}", remedy


def _telling_rows(frames: ConvertedSource) -> Integers:
    """Rows where there is something to be seen."""
    n = frames.shape[0]
    there = np.flatnonzero(textured(Scan(frames, np.zeros(n), np.arange(n))))
    middles = np.quantile(there, (np.arange(ROWS) + 0.5) / ROWS, method="lower")
    return np.unique(middles.astype(np.intp))


def _log_left_out(left_out: Mapping[int, str], name: str) -> None:
    """Say which frames are left out, those with the same reason together."""
    by_reason: dict[str, list[int]] = {}
    for frame, why in sorted(left_out.items()):
        by_reason.setdefault(why, []).append(frame)
    for why, frames in by_reason.items():
        log.warning("%s: frames %s left out: %s", name, spans(np.array(frames)), why)


def _warn_of_skipped(contents: Contents, theta: Floats) -> None:
    """Warn where the camera's number says that a frame is missing, and the angles do not."""
    steps = np.abs(np.diff(theta))
    usual = steps < USUAL_STEP * np.nanmedian(steps)
    for frame in skipped(contents.labels, usual):
        log.warning(
            "%s: the camera's number skips some frames before frame %d, and the recorded step "
            "there is the usual one: angles from there on may belong to other frames",
            contents.path.name,
            frame,
        )
