"""The edge that changed most, and how sharp it is with either set of angles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tomoslam_stage.comparison.named import wholes
from tomoslam_stage.comparison.regions import (
    Mask,
    Window,
    disc,
    most_changed_first,
    most_changed_material,
)

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels, Reconstructions

REACH_SHARE = 0.25
"""Of the window: how far a profile goes to either side of the edge."""
REACH_PX = 6.0, 25.0
"""The least and the most of it."""
STEP_PX = 0.1
SIDE_BY_SIDE = (-1.0, 0.0, 1.0)
"""px along the edge: lines whose mean is the profile."""
EDGE_SIGMA, CHANGE_SIGMA = 1.5, 2.0
"""px: noise is no edge, and what changes at an edge changes beside its middle."""
FLAT = 0.1
"""Of the steepest slope: an edge ends where it is no steeper."""


@dataclass(frozen=True)
class Edge:
    """A line across an edge, from what attenuates less to what attenuates more."""

    middle: tuple[float, float]
    """z, x of the edge, px."""
    direction: tuple[float, float]
    """z, x of the line's direction; its length is 1."""
    reach: float
    """px the line goes to either side."""

    @property
    def places(self) -> Floats:
        """(p,) px from the edge along the line."""
        steps = round(self.reach / STEP_PX)
        return np.arange(-steps, steps + 1, dtype=np.float64) * STEP_PX

    @property
    def ends(self) -> tuple[Floats, Floats]:
        """Z and x of both ends, (2,) px each."""
        both = np.array([-self.reach, self.reach])
        return (
            self.middle[0] + both * self.direction[0],
            self.middle[1] + both * self.direction[1],
        )

    def profile(self, image: Pixels) -> Floats:
        """(p,) grey values of `image` (z, x) along the line, by cubic splines."""
        from scipy.ndimage import map_coordinates

        (z, x), (down, right) = self.middle, self.direction
        aside = np.array(SIDE_BY_SIDE)[:, None]
        at = z + down * self.places + right * aside, x + right * self.places - down * aside
        return np.asarray(map_coordinates(image.astype(np.float64), at, order=3).mean(axis=0))


def most_changed_edge(
    recorded: Pixels, refined: Pixels, inside: Mask, window: Window
) -> Edge | None:
    """Find the steep place in `window` of two slices (z, x) around which they differ most.

    Edges are looked for in the mean of both, which favours neither. None where nothing differs, or
    where no line fits into the field of view.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    mean, change = (recorded + refined) / 2, np.abs(refined - recorded)
    slopes = [gaussian_filter(mean, EDGE_SIGMA, order=order) for order in ((1, 0), (0, 1))]
    reach = float(np.clip(REACH_SHARE * window.side, *REACH_PX))
    fits = distance_transform_edt(inside) > reach
    counts = np.hypot(*slopes) * gaussian_filter(change, CHANGE_SIGMA) * fits
    seen = window.cut(counts)
    if not seen.max() > 0:
        return None
    down, right = np.unravel_index(np.argmax(seen), seen.shape)
    z, x = window.top + int(down), window.left + int(right)
    slope = np.array([float(s[z, x]) for s in slopes])
    direction = slope / np.hypot(*slope)
    return Edge((z, x), (float(direction[0]), float(direction[1])), reach)


def edge_widths(places: Floats, profiles: Mapping[str, Floats]) -> dict[str, float]:
    """By name: px in which a profile (p,) rises from 10 to 90 %; nan where it does not.

    Both levels are those of the mean of recorded and refined, for all profiles: a smeared edge must
    not look sharp because it rises to half of what it should.
    """
    low, high = feet((profiles["recorded"] + profiles["refined"]) / 2)
    if not high > low:
        return dict.fromkeys(profiles, float("nan"))
    return {name: rise(places, (one - low) / (high - low)) for name, one in profiles.items()}


def feet(profile: Floats) -> tuple[float, float]:
    """Grey values at which the edge in the middle of `profile` (p,) begins and ends."""
    slope = np.gradient(profile)
    middle, around = len(slope) // 2, round(CHANGE_SIGMA / STEP_PX)
    near = slice(max(middle - around, 0), middle + around + 1)
    steepest = near.start + int(np.argmax(slope[near]))
    flat = np.flatnonzero(slope <= FLAT * slope[steepest])
    before, after = flat[flat < steepest], flat[flat > steepest]
    low = profile[before[-1]] if len(before) else profile[0]
    high = profile[after[0]] if len(after) else profile[-1]
    return float(low), float(high)


def rise(places: Floats, share: Floats) -> float:
    """Px between 10 and 90 % of a profile `share` (p,), 0 to 1, about where it rises through half.

    Nan where it does not rise so far.
    """
    half = np.flatnonzero((share[:-1] < 0.5) & (share[1:] >= 0.5))
    if not len(half):
        return float("nan")
    k = int(half[np.argmin(np.abs(places[half]))])
    below, above = np.flatnonzero(share[: k + 1] <= 0.1), np.flatnonzero(share[k + 1 :] >= 0.9)
    if not len(below) or not len(above):
        return float("nan")
    start, end = int(below[-1]), k + 1 + int(above[0])
    at_10 = np.interp(0.1, share[start : start + 2], places[start : start + 2])
    at_90 = np.interp(0.9, share[end - 1 : end + 1], places[end - 1 : end + 1])
    return float(at_90 - at_10)


def widths_of_most_changed(reconstructions: Reconstructions) -> dict[str, float]:
    """By name: px in which the most changed edge of the most changed slice rises.

    Empty where no edge changed.
    """
    made = wholes(reconstructions)
    if not {"recorded", "refined"} <= set(made) or not len(made["recorded"].rows):
        return {}
    index = most_changed_first(made["recorded"].slices, made["refined"].slices)[0]
    images = {name: one.slices[index] for name, one in made.items()}
    inside = disc(images["recorded"].shape)
    pair = images["recorded"], images["refined"]
    edge = most_changed_edge(*pair, inside, most_changed_material(*pair, inside))
    if edge is None:
        return {}
    return edge_widths(edge.places, {name: edge.profile(one) for name, one in images.items()})
