"""Which angle has no frame, or which frame has no angle: what the images say about it.

Two witnesses. Neighbouring projections differ by what one step does: a frame that repeats the one
before it hardly does, and across a missing one the images change as over two steps. And where
angles and frames are paired wrongly, everything behind the fault is seen from one step beside its
angle, so that a reconstruction explains the projections worse, half and full turn included. The
witnesses are heard and shown; it is for the user to decide.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from tomoslam_stage.images import highpass
from tomoslam_stage.reprojection import Reprojection, binned
from tomoslam_stage.scans.pairing import spans

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers, Pixels

MOST = 3
"""More frames or angles than this are not looked for."""
FEWEST_FRAMES = 24
"""Fewer show no usual step."""
COLUMNS, ROWS = 128, 4
"""Columns that sinograms are binned to, or not quite twice as many, and rows that are looked at."""
GRID = 48
"""Places tried at first: over half a turn only those within ten degrees feel the right one."""
AROUND = 5
"""Frames on either side that tell how much images usually change."""
REPEATED, DOUBLED = 0.7, 1.35
"""Change from one image to the next, in units of the usual, that stands out."""
STARTS = 4
"""Best ones of them, from each of which the search goes on: both ends are good places, too."""
NEAR, CLOSE = 3, 0.2
"""Places around the best that may be as good, though so much of what there is to gain is lost."""
SURE = 0.003
"""Share of the residual by which the right place must be better than the worst."""


@dataclass(frozen=True)
class Series:
    """Some rows of the frames that are not bad, and all angles."""

    sinograms: Pixels
    """(r, g, column) line integrals."""
    good: Integers
    """(g,) their numbers among the frames."""
    n_frames: int
    """Frames in the file."""
    theta: Floats
    """(a,) radians."""

    @property
    def extra(self) -> int:
        """Frames without an angle or, negative, angles without a frame."""
        return self.n_frames - len(self.theta)

    @property
    def count(self) -> int:
        """Frames, or angles, that may be left out."""
        return max(self.n_frames, len(self.theta))

    @property
    def what(self) -> str:
        """What is left out."""
        return "frame" if self.extra > 0 else "angle"

    @property
    def option(self) -> str:
        """The option that says which they are."""
        return f"--drop-{self.what}s"

    def small(self) -> Series:
        """Return the same with few columns."""
        binning = max(1, self.sinograms.shape[-1] // COLUMNS)
        return replace(self, sinograms=binned(self.sinograms, binning))

    def without(self, places: Integers) -> tuple[Pixels, Floats]:
        """Sinograms (r, n, column) and angles (n,) that are left without frames, or angles."""
        if self.extra < 0:
            return self.sinograms, np.delete(self.theta, places)[self.good]
        kept = np.setdiff1d(self.good, places)
        angle = kept - np.searchsorted(places, kept)
        return self.sinograms[:, np.isin(self.good, kept)], self.theta[angle]


@dataclass
class Search:
    """Looks for what must be left out for the rest to be explained best."""

    series: Series
    judge: Reprojection = field(default_factory=Reprojection)
    known: dict[tuple[int, ...], float] = field(default_factory=dict)
    """By places left out: mean squared residual."""
    axis: float = np.nan
    """Column of the rotation axis; a step more or less of some angles does not move it far."""

    def best(self, guess: Integers) -> Integers:
        """(d,) places, increasing, improved one after the other from `guess`, or neighbours."""
        d = len(guess)
        grid = np.unique(np.linspace(0, self.series.count - d, GRID).astype(np.intp))
        self.axis = self.judge.find_axis(*self.series.without(guess))
        together = [first + np.arange(d) for first in grid]
        places: Integers = min([guess, *together], key=self.square)
        tried = np.union1d(grid, guess)
        for _ in range(min(2, d)):
            for moving in range(d):
                fixed = np.delete(places, moving)
                free = np.setdiff1d(np.append(tried, places[moving]), fixed)
                starts = sorted(free.tolist(), key=partial(self._with, fixed))[:STARTS]
                ends = [self._walked(start, fixed, self.series.count) for start in starts]
                places = np.sort(np.append(fixed, min(ends, key=partial(self._with, fixed))))
        return places

    def _walked(self, place: int, fixed: Integers, count: int) -> int:
        """Walk downhill from `place`, in ever shorter steps."""
        step = max(1, count // GRID)
        while step:
            near = [p for p in (place, place - step, place + step) if 0 <= p < count]
            lower = min((p for p in near if p not in fixed), key=partial(self._with, fixed))
            if lower == place:
                step //= 2
            place = lower
        return place

    def about_as_good(self, places: Integers, moving: int, guess: Integers) -> Integers:
        """Places near one of `places`, or in `guess`, that are hardly worse in its stead."""
        fixed, place = np.delete(places, moving), int(places[moving])
        least, most = self.square(places), max(self.known.values())
        near = np.arange(max(0, place - NEAR), min(self.series.count, place + NEAR + 1))
        most_left = least + CLOSE * (most - least)
        free = np.setdiff1d(np.append(near, guess), fixed).tolist()
        return np.array([p for p in free if self._with(fixed, p) <= most_left], dtype=np.intp)

    def _with(self, fixed: Integers, place: int) -> float:
        return self.square(np.sort(np.append(fixed, place)))

    def square(self, places: Integers) -> float:
        """Mean squared residual without `places` (d,)."""
        key = tuple(places.tolist())
        if key not in self.known:
            squares = self.judge.squares(*self.series.without(places), self.axis)
            self.known[key] = float(squares.mean())
        return self.known[key]


def finding(series: Series) -> tuple[str, str]:
    """Say in numbers what the images show, and which option follows from it."""
    ask = f"Pass {series.option} with their numbers, counted from 0."
    if abs(series.extra) > MOST or len(series.good) < FEWEST_FRAMES:
        return f"{abs(series.extra)} cannot be told from {len(series.good)} images.", ask
    if not np.ptp(series.sinograms, axis=1).any():
        return "The images are all alike, and do not show which.", ask
    series = series.small()
    change = Change.of(series)
    search = Search(series)
    places = search.best(change.guess())
    least, most = (np.sqrt(end) for end in (search.square(places), max(search.known.values())))
    if most < (1 + SURE) * least:
        return "The images are explained equally well whichever it is.", ask
    places = change.decide(places, search)
    found = (
        f"A reconstruction explains the images best without {series.what} {spans(places)} "
        f"(residual {least:.4g}, up to {most:.4g} without others)"
    )
    remedy = f"Pass {series.option} {spans(places)}."
    return f"{found}{change.told(places)}.", remedy + either_end(search, places)


@dataclass(frozen=True)
class Change:
    """How much the images change from one frame to the next."""

    series: Series
    ratio: Floats
    """(m,) from the frame before, in units of what is usual around; NaN where either is bad."""
    doubled: float
    """What two steps at once come to, in the same units."""

    @classmethod
    def of(cls, series: Series) -> Change:
        """Look at what is fine in the images."""
        fine = highpass(series.sinograms, Reprojection().cutoff)
        one, two = (
            np.sqrt(np.mean(np.square(fine[:, k:] - fine[:, :-k]), axis=(0, 2), dtype=np.float64))
            for k in (1, 2)
        )
        usual = median_filter(one, 2 * AROUND + 1, mode="mirror")
        floor = max(float(np.median(one)) / 100, 1e-12)
        ratio = np.full(series.n_frames, np.nan)
        next_to = np.diff(series.good) == 1
        ratio[series.good[1:][next_to]] = (one / np.maximum(usual, floor))[next_to]
        return cls(series, ratio, float(np.median(two)) / max(float(np.median(one)), floor))

    def guess(self) -> Integers:
        """(d,) places that these changes speak for; the last ones, where they say nothing."""
        d, found = abs(self.series.extra), list[int]()
        if self.series.extra > 0:
            repeats = np.flatnonzero(self.ratio < REPEATED)
            found = repeats[np.argsort(self.ratio[repeats])].tolist()
        elif self.doubled > DOUBLED:
            jumps = np.flatnonzero(self.ratio > DOUBLED)
            for frame in jumps[np.argsort(-self.ratio[jumps])].tolist():
                missing = round((self.ratio[frame] - 1) / (self.doubled - 1))
                found += [frame] * max(1, min(missing, d - len(found)))
        last = range(self.series.count - 1, -1, -1)
        frames = np.sort(np.array(found[:d], np.intp))
        # An angle without a frame follows as many others as had none before it.
        places = frames if self.series.extra > 0 else frames + np.arange(len(frames))
        more = [place for place in last if place not in places][: d - len(places)]
        return np.sort(np.append(places, np.array(more, np.intp)))

    def decide(self, places: Integers, search: Search) -> Integers:
        """Of places that are explained about as well, take those where the images change so."""
        guess = self.guess()
        for rank in range(len(places)):
            near = search.about_as_good(places, rank, guess)
            outstanding = [self._outstanding(int(place), rank) for place in near]
            if max(outstanding) > 1:
                best = near[np.argmax(outstanding)]
                places = np.sort(np.append(np.delete(places, rank), best))
        return places

    def told(self, places: Integers) -> str:
        """Tell how much the images change at `places`."""
        shown = {}
        for rank, place in enumerate(places.tolist()):
            frame = self._frame(place, rank)
            if np.isfinite(self.ratio[frame]):
                ordinary = self._outstanding(place, rank) <= 1
                shown[frame] = (
                    f"; from frame {frame - 1} to {frame} they change {self.ratio[frame]:.2f} "
                    "times as much as between their neighbours"
                    f"{', which is nothing unusual' if ordinary else ''}"
                )
        two = f" (two steps at once: {self.doubled:.2f} times)"
        return "".join(shown.values()) + (two if shown and self.series.extra < 0 else "")

    def _frame(self, place: int, rank: int) -> int:
        """Return the first frame behind a place, so many others being left out before it."""
        frame = place if self.series.extra > 0 else place - rank
        return min(frame, len(self.ratio) - 1)

    def _outstanding(self, place: int, rank: int) -> float:
        """More than one where the images change as if `place` were to be left out."""
        ratio = float(self.ratio[self._frame(place, rank)])
        if not np.isfinite(ratio):
            return 0.0
        return REPEATED / max(ratio, 1e-6) if self.series.extra > 0 else ratio / DOUBLED


def either_end(search: Search, places: Integers) -> str:
    """Say so where the first may be meant as well as the last: all angles shift together then."""
    ends = {0: search.series.count - 1, search.series.count - 1: 0}
    if len(places) != 1 or int(places[0]) not in ends:
        return ""
    other = ends[int(places[0])]
    if search.square(np.array([other])) > (1 + SURE) * search.square(places):
        return ""
    return f" {other} would do as well: which end it is only turns all slices."
