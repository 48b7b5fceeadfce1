"""What an NXtomo entry holds: projections, flats and darks in one stack, told apart by a key.

The entry, its detector and its sample are found by their NeXus classes and by the attribute
``default``, not by their names; data may be links or virtual, as beamlines write them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans.beam import read_beam
from tomoslam_stage.scans.contents import (
    BESIDES,
    Contents,
    Places,
    References,
    look_at,
    way_to,
)
from tomoslam_stage.scans.labels import NEXUS_KEY, Labels
from tomoslam_stage.scans.strings import read_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from h5py import File

    from tomoslam_stage.products import Integers
    from tomoslam_stage.scans.datasets import DatasetFacts

DEFINITION = "NXtomo"
KEYS = ("image_key_control", "image_key")
"""Where a detector says what its frames are of; the first tells alignment images apart, too."""
MEANING: Mapping[int, str] = {-1: "alignment", **NEXUS_KEY}
ANGLES = "rotation_angle"
DEPTH = 3
"""Entries, and entries within entries, are looked for down to here."""


@dataclass(frozen=True)
class NxTomo:
    """The NeXus application definition for tomography, at one entry of a file."""

    name: ClassVar[str] = "NXtomo"
    mixed: ClassVar[bool] = True

    entry: str
    """Path of the group of class NXentry or NXsubentry."""
    detector: str
    sample: str

    @property
    def places(self) -> Places:
        """Where the entry keeps what."""
        angles, actor = f"{self.sample}/{ANGLES}", f"{self.entry}/tomoslam_stage"
        return Places(
            data=f"{self.detector}/data",
            theta=angles,
            recorded=f"{angles}_recorded",
            sigma=f"{angles}_errors",
            actor=actor,
            table=f"{actor}/table",
        )

    def read(self, file: File, path: Path) -> Contents:
        """Look at everything but the pixels."""
        found = look_at(file, path, self)
        labels, wrong = self._labels(file, found.datasets.get(self.places.data))
        return replace(
            found,
            flats=self._references("flat", labels, found.datasets),
            darks=self._references("dark", labels, found.datasets),
            flat_positions=flat_positions(labels.kinds),
            beam=read_beam(file, (self.detector.rpartition("/")[0],)),
            labels=labels,
            wrong=wrong,
        )

    def _labels(
        self, file: File, data: DatasetFacts | None
    ) -> tuple[Labels, tuple[str, str] | None]:
        """Tell the frames apart; and say why that is not possible, where it is not."""
        place = next((p for k in KEYS if (p := f"{self.detector}/{k}") in file), "")
        if not place or data is None or not data.shape:
            return Labels(), None  # without a key all frames are projections
        keys, n = np.ravel(file[place][()]), data.shape[0]
        if len(keys) != n:
            found = f"{place} holds {len(keys)} keys for {n} frames; one for each is needed."
            return Labels(), (found, "Write the key again from the plan of the scan.")
        unknown = sorted(set(keys.tolist()) - MEANING.keys())
        if unknown:
            known = "0 (projection), 1 (flat), 2 (dark) and 3 (invalid) are known."
            return Labels(), (f"{place} holds {unknown[0]}; {known}", "Correct the key.")
        return Labels(kinds=tuple(MEANING[int(key)] for key in keys), kinds_from=place), None

    def _references(
        self, kind: str, labels: Labels, datasets: Mapping[str, DatasetFacts]
    ) -> References | None:
        frames = np.flatnonzero(labels.are(kind))
        place = self.places.data
        return References(place, datasets[place].shape, frames) if len(frames) else None

    def aliases(self, file: File, place: str) -> list[str]:
        """List its names in the NXdata groups of the entry."""
        dataset = file.get(place)
        return [
            f"{plot}/{name}"
            for plot in _children(file, self.entry, ("NXdata",))
            if file[plot].file == file
            for name in file[plot]
            if file[plot].get(name) == dataset
        ]

    def declare(self, file: File, version: str) -> None:
        """Make the record of this program a process in the terms of NeXus."""
        actor = file[self.places.actor]
        actor.attrs["NX_class"] = "NXprocess"
        for name, said in (("program", "tomoslam_stage"), ("version", version)):
            if name in actor:
                del actor[name]
            actor[name] = said
        for name in ("settings", "table"):
            if name in actor:
                actor[name].attrs["NX_class"] = "NXcollection"

    def link(self, companion: File, scan: File, scan_seen: str) -> None:
        """Make an entry of its own, all but the angles links into the scan."""
        import h5py

        companion.attrs["NX_class"] = "NXroot"
        companion.attrs["default"] = self.entry.strip("/")
        ours = {self.places.actor, *self._beside(ANGLES)}
        steps = [*way_to(self.entry), self.sample]
        for place in steps:
            group = companion.require_group(place)
            group.attrs.update(scan[place].attrs)
            for name in scan[place]:
                inner = f"{place}/{name}"
                if inner not in ours and inner not in steps:
                    group[name] = h5py.ExternalLink(scan_seen, inner)
        self._link_plots(companion, scan, scan_seen)
        places = self.places
        source = places.recorded if places.is_ours(scan) else places.theta
        scan.copy(scan[source], companion[self.sample], name=f"{ANGLES}_recorded")

    def _beside(self, name: str) -> tuple[str, ...]:
        return tuple(f"{self.sample}/{name}{end}" for end in ("", "_recorded", "_errors"))

    def _link_plots(self, companion: File, scan: File, scan_seen: str) -> None:
        """Let the NXdata groups of the companion show its own angles."""
        import h5py

        for plot in _children(scan, self.entry, ("NXdata",)):
            if ANGLES not in scan[plot]:
                continue
            del companion[plot]
            group = companion.create_group(plot)
            group.attrs.update(scan[plot].attrs)
            for name in scan[plot]:
                link = h5py.ExternalLink(scan_seen, f"{plot}/{name}")
                group[name] = h5py.SoftLink(self.places.theta) if name == ANGLES else link


def flat_positions(kinds: tuple[str, ...]) -> tuple[float, ...]:
    """Return when each flat was taken, in frames: the middle of those with no projection between.

    >>> flat_positions(("flat", "dark", "flat", "projection", "projection", "flat"))
    (1.0, 1.0, 5.0)
    """
    frames = np.array([i for i, kind in enumerate(kinds) if kind == "flat"], np.intp)
    others = np.cumsum([kind not in BESIDES for kind in kinds])
    before: Integers = others[frames] if len(frames) else frames
    return tuple(float(frames[before == moment].mean()) for moment in before)


def find_nxtomo(file: File, name: str) -> NxTomo | None:
    """Return the NXtomo entry of a file; None where there is none.

    Raises
    ------
    ScanError
        If there are several and the attribute ``default`` of the file names none of them.
    """
    entries = _entries(file, "")
    found = {place: layout for place in entries if (layout := _layout_at(file, place))}
    if len(found) < 2:
        return next(iter(found.values()), None)
    default = "/" + read_text(file.attrs.get("default", "")).strip("/")
    chosen = [place for place in found if f"{place}/".startswith(f"{default}/")]
    if not chosen:
        raise ScanError(
            name,
            f"there are {len(found)} NXtomo entries: {', '.join(sorted(found))}; one is needed.",
            "Let the attribute `default` of the file name the one to refine.",
        )
    return found[min(chosen)]


def _entries(file: File, place: str, depth: int = 0) -> Iterator[str]:
    """Yield the groups that may be NXtomo entries."""
    for inner in _children(file, place, ("NXentry", "NXsubentry")):
        yield inner
        if depth < DEPTH:
            yield from _entries(file, inner, depth + 1)


def _layout_at(file: File, entry: str) -> NxTomo | None:
    """Return the layout of an entry that is, or looks like, NXtomo."""
    samples = _children(file, entry, ("NXsample",), "sample")
    detectors = [
        detector
        for instrument in _children(file, entry, ("NXinstrument",), "instrument")
        for detector in _children(file, instrument, ("NXdetector",), "detector")
        if _has(file, f"{detector}/data")
    ]
    definition = file[entry].get("definition")
    declared = read_text(definition[()]) == DEFINITION if hasattr(definition, "dtype") else False
    turning = [sample for sample in samples if _has(file, f"{sample}/{ANGLES}")]
    keyed = [d for d in detectors if any(_has(file, f"{d}/{key}") for key in KEYS)]
    if not (detectors and turning and (declared or keyed)):
        return None
    return NxTomo(entry, (keyed or detectors)[0], turning[0])


def _has(file: File, place: str) -> bool:
    """Whether there is a link of this name, wherever it leads."""
    return file.get(place, getlink=True) is not None


def _children(file: File, place: str, classes: tuple[str, ...], name: str = "") -> list[str]:
    """List groups in `place` of these NeXus classes; where there is none, that of this name."""
    groups = [f"{place}/{inner}" for inner in file[place or "/"] if _is_group(file, place, inner)]
    found = [g for g in groups if read_text(file[g].attrs.get("NX_class", "")) in classes]
    return found or [group for group in groups if name and group == f"{place}/{name}"]


def _is_group(file: File, place: str, name: str) -> bool:
    """Whether a link leads to a group; a broken one does not."""
    import h5py

    try:
        return isinstance(file[f"{place}/{name}"], h5py.Group)
    except (KeyError, OSError, RuntimeError):
        return False
