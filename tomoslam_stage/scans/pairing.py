"""Which angle belongs to which frame of a file, and which frames are left out.

What the user says comes first, then what the file says about its frames. Where neither makes one
angle for each frame, nothing is guessed.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.errors import PipelineError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomoslam_stage.products import Integers
    from tomoslam_stage.scans.labels import Labels

log = logging.getLogger("tomoslam_stage")

NO_ANGLE = -1
ASKED = "asked for"


@dataclass(frozen=True)
class Choice:
    """What a user says about the frames of a file, in words that `numbers` reads."""

    drop_frames: str = ""
    """Frames that are left out."""
    keep_frames: str = ""
    """The only frames that are not; they stay even where they look bad."""
    drop_angles: str = ""
    """Entries of theta that have no frame."""


@dataclass(frozen=True)
class Pairing:
    """The angle of each frame."""

    angle: Integers
    """(m,) entry of theta that belongs to each frame, or `NO_ANGLE`."""
    left_out: Mapping[int, str] = field(default_factory=dict)
    """Frame -> why it is no projection of the scan."""

    def __post_init__(self) -> None:
        nameless = set(np.flatnonzero(self.angle == NO_ANGLE).tolist()) - self.left_out.keys()
        if nameless:
            raise ValueError(f"frames {sorted(nameless)} have no angle and are not left out")

    @property
    def frames(self) -> Integers:
        """(n,) the frames that are used."""
        used = np.ones(len(self.angle), bool)
        used[list(self.left_out)] = False
        return np.flatnonzero(used)

    def without(self, frames: Mapping[int, str]) -> Pairing:
        """Leave out more frames; they keep their angles."""
        return replace(self, left_out={**frames, **self.left_out})


def paired(counts: tuple[int, int], labels: Labels, choice: Choice) -> Pairing | None:
    """Give each frame its angle; None where there is not one for each.

    Parameters
    ----------
    counts
        Frames in the file, and angles.
    labels
        What the file says about its frames.
    choice
        What the user says.

    Raises
    ------
    PipelineError
        For numbers that cannot be read, that the file does not have, or that do not match.
    """
    n_frames, n_angles = counts
    kept = np.ones(n_frames, bool)
    if choice.keep_frames:
        kept[:] = False
        kept[numbers(choice.keep_frames, n_frames, "keep_frames")] = True
    kept[numbers(choice.drop_frames, n_frames, "drop_frames")] = False
    angles = np.ones(n_angles, bool)
    angles[numbers(choice.drop_angles, n_angles, "drop_angles")] = False
    asked = dict.fromkeys(np.flatnonzero(~kept).tolist(), ASKED)
    found = _in_order(np.flatnonzero(angles), asked, n_frames)
    if found is not None and n_frames == n_angles:
        return found.without(_no_projections(labels, n_frames))
    if found is None and choice.drop_angles:
        said = (
            f"{angles.sum()} angles are left for {n_frames} frames, {len(asked)} of them left out"
        )
        raise PipelineError("load_scan.drop_angles", f"{said}; one for each frame is needed.")
    if found is None:
        found = _by_labels(counts, labels)
        found = None if found is None else found.without(asked)
    return found


def _in_order(angles: Integers, left_out: Mapping[int, str], n_frames: int) -> Pairing | None:
    """Give `angles` to the frames in order: to all, else to those that are not left out."""
    if len(angles) == n_frames:
        return Pairing(angles, left_out)
    if len(angles) != n_frames - len(left_out):
        return None
    angle = np.full(n_frames, NO_ANGLE)
    angle[[frame for frame in range(n_frames) if frame not in left_out]] = angles
    return Pairing(angle, left_out)


def _no_projections(labels: Labels, n_frames: int) -> dict[int, str]:
    """Frame -> what it is of instead, as the file says."""
    if len(labels.kinds) != n_frames or "projection" not in labels.kinds:
        return {}
    return {
        frame: f"{kind} by {labels.kinds_from}"
        for frame, kind in enumerate(labels.kinds)
        if kind != "projection"
    }


def _by_labels(counts: tuple[int, int], labels: Labels) -> Pairing | None:
    """Let what the file says about its frames settle it, where it does to the last frame."""
    n_frames, n_angles = counts
    found = _in_order(np.arange(n_angles), _no_projections(labels, n_frames), n_frames)
    if found is not None:
        return found
    if len(labels.kinds) == n_angles and labels.are("projection").sum() == n_frames:
        log.info(
            "angles of projections are told from those of other frames by %s", labels.kinds_from
        )
        return Pairing(np.flatnonzero(labels.are("projection")))
    return _by_ids(counts, labels)


def _by_ids(counts: tuple[int, int], labels: Labels) -> Pairing | None:
    n_frames, n_angles = counts
    steps = labels.steps()
    if steps is None:
        return None
    repeated = np.flatnonzero(steps == 0) + 1
    if len(repeated) == n_frames - n_angles:
        why = "same number from the camera as the frame before"
        return _in_order(np.arange(n_angles), dict.fromkeys(repeated.tolist(), why), n_frames)
    if len(repeated) == 0 and steps.sum() == n_angles - 1:
        angle = np.concatenate([[0], np.cumsum(steps)])
        missing = np.setdiff1d(np.arange(n_angles), angle)
        log.info("the camera's numbers skip angles %s: these have no frame", spans(missing))
        return Pairing(angle)
    return None


def skipped(labels: Labels, usual: NDArray[np.bool_]) -> Integers:
    """Frames before which the camera's number skips some, though the recorded step is `usual`.

    Parameters
    ----------
    labels
        What the file says about its frames.
    usual
        (m - 1,) whether the recorded step from each frame to the next is about as long as most.
    """
    steps = labels.steps()
    if steps is None or len(steps) != len(usual):
        return np.empty(0, np.intp)
    return np.flatnonzero((steps > 1) & usual) + 1


def numbers(text: str, count: int, what: str) -> Integers:
    """Read ``12,40:43,-1`` as Python would index `count` things: 12, 40, 41, 42 and the last.

    Raises
    ------
    PipelineError
        If it cannot be read, or names what is not there.
    """
    chosen: list[int] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        try:
            ends = [int(end) if end.strip() else None for end in part.split(":")]
        except ValueError:
            ends = []
        if not 1 <= len(ends) <= 3 or (len(ends) == 1 and ends[0] is None) or ends[2:] == [0]:
            needed = "numbers and FROM:BEFORE, as in 12,40:43, are needed."
            raise PipelineError(f"load_scan.{what}", f"{part!r} cannot be read; {needed}")
        if len(ends) == 1:
            chosen.append(_inside(int(part), count, what))
        else:
            chosen += range(*slice(*ends).indices(count))
    return np.unique(np.array(chosen, np.intp))


def _inside(number: int, count: int, what: str) -> int:
    if not -count <= number < count:
        needed = f"{what.partition('_')[2]} from 0 to {count - 1} are there."
        raise PipelineError(f"load_scan.{what}", f"there is no {number}; {needed}")
    return number % count


def spans(some: Integers) -> str:
    """Write increasing numbers as `numbers` reads them: ``12,40:43``."""
    parts = np.split(some, np.flatnonzero(np.diff(some) > 1) + 1)
    return ",".join(
        str(part[0]) if len(part) == 1 else f"{part[0]}:{part[-1] + 1}"
        for part in parts
        if len(part)
    )
