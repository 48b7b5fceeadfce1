"""What a file says about single frames: the camera's numbers for them, and what each is of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from h5py import File
    from numpy.typing import NDArray

    from tomoslam_stage.products import Integers

UNIQUE_IDS = "/defaults/NDArrayUniqueId"
"""Where areaDetector's file writer puts the camera's numbers; tomoscan looks for them here."""
LOCATION = "/defaults/HDF5FrameLocation"
"""Where it puts the dataset that each frame went to."""
NEXUS_KEY: Mapping[int, str] = {0: "projection", 1: "flat", 2: "dark", 3: "invalid"}
DXCHANGE_TYPE: Mapping[int, str] = {0: "flat", 1: "projection", 2: "dark"}
KINDS: Mapping[str, Mapping[int, str]] = {
    "/exchange/image_key": NEXUS_KEY,
    "/image_key": NEXUS_KEY,
    "/process/acquisition/image_key": NEXUS_KEY,
    "/measurement/instrument/detector/image_key": NEXUS_KEY,
    "/exchange/image_type": DXCHANGE_TYPE,
    "/process/acquisition/image_type": DXCHANGE_TYPE,
    "/defaults/image_type": DXCHANGE_TYPE,
}
"""Dataset with a number for each frame -> what the numbers mean."""


@dataclass(frozen=True)
class Labels:
    """What was found."""

    ids: Integers | None = None
    """(m,) the camera's number of each frame in ``/exchange/data``."""
    kinds: tuple[str, ...] = ()
    """What each frame is of: those in ``/exchange/data``, or all that were taken."""
    kinds_from: str = ""
    """The dataset that says so."""

    def are(self, kind: str) -> NDArray[np.bool_]:
        """(k,) whether a frame is of this kind."""
        return np.array([each == kind for each in self.kinds], bool)

    def steps(self) -> Integers | None:
        """(m - 1,) by how much the camera's number rises; None where it does not count frames."""
        if self.ids is None or len(self.ids) < 2:
            return None
        steps = np.diff(self.ids)
        return steps if steps.min() >= 0 and np.median(steps) == 1 else None


def read_labels(file: File, n_frames: int, located: Sequence[str], data: str) -> Labels:
    """Collect what `file` says about its frames.

    Parameters
    ----------
    file
        Open.
    n_frames
        Frames in ``/exchange/data``.
    located
        The dataset that each frame went to, in order of acquisition; empty where nobody says.
    data
        What that dataset is called for projections.
    """
    ids, places = _numbers(file, UNIQUE_IDS), np.array([place == data for place in located], bool)
    if ids is not None and len(ids) == len(places):
        ids = ids[places]
    ids = ids if ids is not None and len(ids) == n_frames else None
    for key, meaning in KINDS.items():
        numbers = _numbers(file, key)
        if numbers is not None and set(numbers.tolist()) <= meaning.keys():
            return Labels(ids, tuple(meaning[int(number)] for number in numbers), key)
    kinds = tuple("projection" if place == data else "other" for place in located)
    return Labels(ids, kinds, LOCATION if kinds else "")


def _numbers(file: File, key: str) -> Integers | None:
    """Return the whole numbers (k,) at `key`, or None."""
    import h5py

    dataset: Any = file.get(key)
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "iu":
        return None
    return np.asarray(dataset[()], np.intp)
