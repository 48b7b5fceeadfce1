"""What some rows of a scan say about a geometry, with the map that they make there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from tomoslam_stage.geometry import around, spread
from tomoslam_stage.images import highpass, shifted
from tomoslam_stage.mapping.maps import mapped, seen, standing
from tomoslam_stage.parallel import BLOCK, parallel
from tomoslam_stage.radon import Radon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from tomoslam_stage.products import Floats, Geometry, Integers, Pixels

Result = TypeVar("Result")

END = 0.02
"""Widths of the detector that make its ends."""
USUAL = 0.02
"""Strength of the total variation while something else is chosen."""
NEAR = 5
"""Columns over which a blur mixes intensities."""
EMPTY = 0.05
"""Share of the highest line integrals that an end may show and the object still be seen whole."""


class Standing(NamedTuple):
    """A map that stands, whatever other projections show."""

    slices: Pixels
    """(r, z, x) per px."""
    fixed: Pixels
    """(r, 1, column) what the projections it was made from had at the same place."""


class Answer(NamedTuple):
    """What a block of rows answers: residual, and its derivatives, summed over the columns."""

    by_angle: Floats
    """(r, n) residual times derivative by the angle."""
    by_shift: Floats
    """(r, n) residual times derivative by the shift; of all of them together, by the axis."""
    angle_squares: Floats
    """(r, n) derivative by the angle, squared."""
    shift_squares: Floats
    """(r, n) derivative by the shift, squared."""
    products: Floats
    """(r, n) derivative by the angle times derivative by the shift."""
    squares: Floats
    """(r, n) mean squared residual."""
    fixed: Floats
    """(r, 1) mean square of what was taken off the residual, as all projections have it."""


@dataclass(frozen=True)
class Look:
    """What rows say at one geometry, in squared line integrals; entries as in `Layout`."""

    pulls: Floats
    """(r, k) half the slope at which the squared residual of each row falls."""
    conditional: Floats
    """(k,) curvature that goes with it, were the map to stay as it is."""
    squares: Floats
    """(r, n) mean squared residual, but for what all projections have at the same column."""
    heights: Floats
    """(r,) px that each row lies below the one where the axis is at its column."""
    mixed: Floats
    """(n,) curvature by the angle and the shift of a projection, were the map to stay."""
    noise_left: float = 1.0
    """Share of the noise's variance that the rows show, as they were smoothed."""
    fixed: float = 0.0
    """Mean square of what all projections have at the same column."""

    @property
    def pull(self) -> Floats:
        """(k,) that of all rows."""
        return np.asarray(self.pulls.sum(axis=0))


@dataclass(frozen=True)
class Observed:
    """Some rows of a scan, and how a map is made of them."""

    sinograms: Pixels
    """(r, n, column) line integrals, columns binned."""
    rows: Integers
    """(r,) where they are in the scan."""
    binning: int
    """Columns of the scan in one of `sinograms`."""
    cutoff: float
    """Px of the scan: what is smoother along the columns does not count."""
    extent: float = 1.0
    """Side of the map, in widths of the detector."""
    strength: float = 0.0
    """Of the total variation, in standard deviations of a slice."""
    faintest: float = 0.0
    """Share of the densest place below which there is air, made empty; 0: nothing negative."""
    blur: float = 0.0
    """Px of the scan: that of the intensities, which was mended."""
    noise_left: float = 1.0
    """Share of the noise's variance that smoothing over rows left."""

    def part(self, count: int) -> Observed:
        """About `count` of the rows, evenly spread."""
        some = spread(len(self.rows), count)
        return replace(self, sinograms=self.sinograms[some], rows=self.rows[some])

    def look(self, geometry: Geometry, standing_map: Standing | None = None) -> Look:
        """Make the map of `geometry`, unless one stands already, project it, and compare."""
        radon = self._radon(geometry)

        def answer(block: slice) -> Answer:
            sinograms = self._aligned(geometry, block)
            if standing_map is None:
                return self._answer(sinograms, radon, self._mapped(sinograms, radon))
            return self._answer(sinograms, radon, *(part[block] for part in standing_map))

        answers = Answer(*map(np.concatenate, zip(*self._of_blocks(answer), strict=True)))
        heights = np.asarray(self.rows - geometry.middle, np.float64)
        layout, size = geometry.layout, geometry.layout.size
        pulls, conditional = np.zeros((len(self.rows), size)), np.zeros(size)
        pulls[:, layout.angles] = answers.by_angle
        conditional[layout.angles] = answers.angle_squares.sum(axis=0)
        if "shift" in layout.unknowns:
            pulls[:, layout.shifts] = answers.by_shift / self.binning
            conditional[layout.shifts] = answers.shift_squares.sum(axis=0) / self.binning**2
        # A row's axis lies in columns of its own.
        axis = answers.by_shift.sum(axis=1) / self.binning
        curved = answers.shift_squares.sum(axis=1) / self.binning**2
        pulls[:, layout.line] = np.column_stack([axis, axis * heights])
        conditional[layout.line] = curved.sum(), (curved * heights**2).sum()
        mixed = answers.products.sum(axis=0) / self.binning
        squares, fixed = answers.squares, float(answers.fixed.mean())
        return Look(pulls, conditional, squares, heights, mixed, self.noise_left, fixed)

    def standing(self, geometry: Geometry) -> Standing:
        """Make the map of `geometry` that other projections are to be compared with."""
        radon = self._radon(geometry)

        def made(block: slice) -> Standing:
            sinograms = self._aligned(geometry, block)
            slices = self._mapped(sinograms, radon)
            left = self._fine(seen(sinograms) - radon.project(slices))
            return Standing(slices, standing(left))

        return Standing(*map(np.concatenate, zip(*self._of_blocks(made), strict=True)))

    def left_out(self, geometry: Geometry) -> float:
        """Mean squared error of predicting every other projection from the rest.

        Weighed by the intensity: the darker, the more noise there is, and the more a blur hides.
        """
        odd = np.zeros(len(geometry.theta), bool)
        odd[around(geometry.theta)[::2]] = True
        whole = self._radon(geometry)
        used, wanted = (replace(whole, theta=geometry.theta[some]) for some in (odd, ~odd))

        def square(block: slice) -> Floats:
            sinograms = self._aligned(geometry, block)
            slices = self._mapped(sinograms[:, odd], used)
            left = seen(sinograms[:, ~odd]) - wanted.project(slices)
            left -= standing(left)
            squares = np.square(self._fine(left), dtype=np.float64)
            weights = brightness(sinograms[:, ~odd])
            return np.stack([(weights * squares).sum(axis=(1, 2)), weights.sum(axis=(1, 2))])

        errors, together = np.concatenate(list(self._of_blocks(square)), axis=1).sum(axis=1)
        return float(errors / together)

    def _mapped(self, sinograms: Pixels, radon: Radon) -> Pixels:
        """(r, z, x) the map of `sinograms` (r, n, column)."""
        return mapped(sinograms, radon, self.strength, faintest=self.faintest)

    def _answer(
        self, sinograms: Pixels, radon: Radon, slices: Pixels, known: Pixels | None = None
    ) -> Answer:
        """Compare `sinograms` (r, n, column) with `slices` (r, z, x).

        `known` (r, 1, column) is fixed to the detector; by default it is what all of them show.
        """
        projected, by_angle, by_axis = radon.linearised(slices)
        left = self._fine(seen(sinograms) - projected)
        fixed = standing(left) if known is None else known
        left -= fixed
        by_angle, by_axis = self._fine(by_angle), self._fine(by_axis)
        columns = sinograms.shape[-1]
        return Answer(
            _products(left, by_angle),
            _products(left, by_axis),
            _products(by_angle, by_angle),
            _products(by_axis, by_axis),
            _products(by_angle, by_axis),
            _products(left, left) / columns,
            _products(fixed, fixed) / columns,
        )

    def _fine(self, sinograms: Pixels) -> Pixels:
        """Take off what is too smooth to count."""
        return highpass(sinograms, self.cutoff / self.binning)

    def _aligned(self, geometry: Geometry, block: slice) -> Pixels:
        """(r, n, column) the rows of `block`, as if the axis were upright and the sample still."""
        everyone = np.arange(len(geometry.theta) if geometry.shift.any() else 1)
        aside = geometry.axis - geometry.origin(self.rows[block, None], everyone)
        return shifted(self.sinograms[block], aside / self.binning)

    def _radon(self, geometry: Geometry) -> Radon:
        """Return the projector, in binned columns."""
        columns = self.sinograms.shape[-1]
        axis = (geometry.axis + 0.5) / self.binning - 0.5
        return Radon(geometry.theta, axis, columns, round(self.extent * columns))

    def _of_blocks(self, work: Callable[[slice], Result]) -> Iterator[Result]:
        """Do `work` on blocks of rows that are the same for any number of cores."""
        starts = range(0, len(self.rows), BLOCK)
        return parallel(work, [slice(start, start + BLOCK) for start in starts])


def truncated(sinograms: Pixels) -> bool:
    """Whether the object reaches beyond the detector: its ends are not empty."""
    columns = max(2, round(END * sinograms.shape[-1]))
    first, last = sinograms[..., :columns].mean(axis=-1), sinograms[..., -columns:].mean(axis=-1)
    ends = np.maximum(np.abs(first), np.abs(last))
    return bool(np.median(ends) > EMPTY * np.quantile(sinograms, 0.99))


def brightness(sinograms: Pixels) -> Pixels:
    """(r, n, column) least of the intensities that were left near each of the line integrals."""
    from scipy.ndimage import maximum_filter1d

    darkest = maximum_filter1d(np.maximum(sinograms, 0), NEAR, axis=-1, mode="nearest")
    return np.asarray(np.exp(-darkest))


def strongest(seen_rows: Observed, geometry: Geometry, strengths: Iterable[float]) -> float:
    """Return the largest strength within 2 % of the least error on projections left out."""
    errors = left_out_errors(
        geometry, ((each, replace(seen_rows, strength=each)) for each in strengths), 1.08
    )
    least = min(errors.values())
    return max(strength for strength, error in errors.items() if error <= 1.02 * least)


def emptiest(seen_rows: Observed, geometry: Geometry, faintest: Iterable[float]) -> float:
    """Return the share of the densest place below which there is air, best made empty.

    The least within 3 % of the least error on projections left out. Total variation is not made
    less: it predicts them better by smoothing noise, and moves edges, which is worse.
    """
    tried = ((each, replace(seen_rows, faintest=each, strength=0.0)) for each in faintest)
    errors = left_out_errors(geometry, tried, np.inf)
    least = min(errors.values())
    return min(share for share, error in errors.items() if error <= 1.03 * least)


def left_out_errors(
    geometry: Geometry, tried: Iterable[tuple[float, Observed]], rise: float
) -> dict[float, float]:
    """By name: the error on projections left out, until it is `rise` times the least so far."""
    errors: dict[float, float] = {}
    for name, one in tried:
        errors[name] = one.left_out(geometry)
        if errors[name] > rise * min(errors.values()):
            break
    return errors


def _products(first: Pixels, second: Pixels) -> Floats:
    """(r, n) sums over the columns."""
    return np.asarray(np.einsum("rnc,rnc->rn", first, second, dtype=np.float64))
