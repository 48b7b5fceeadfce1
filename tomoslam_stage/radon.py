"""The parallel-beam projector, its derivative, its adjoint and filtered back-projection.

All four evaluate or spread the two-dimensional Fourier transform of a slice on the radial lines of
the projection-slice theorem, through the non-uniform fast Fourier transform (Barnett, Magland and
af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479). Any angles and any axis are as good as any
other, and the derivative with respect to the angle is analytic.

Every transform runs on one thread, so that results do not depend on the number of workers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from tomoslam_stage.geometry import angular_weights
from tomoslam_stage.images import ramp, tapered
from tomoslam_stage.parallel import in_blocks

if TYPE_CHECKING:
    from tomoslam_stage.images import Window
    from tomoslam_stage.products import Floats, Pixels

Spectrum: TypeAlias = NDArray[np.complex64]

ACCURACY = 1e-5
"""Relative error of the transforms; single precision allows little more."""
ASIDE = np.deg2rad(0.02)
"""Radians to either side of an angle for the derivative by it, in `Radon.linearised`."""
SLOW_SIDE = 128
"""A side of the fine grid that is a multiple of this makes the transforms slow."""
REACH = 0.75
"""Widths of the detector that an object may go on for beyond either of its ends."""
FAINT = 0.03
"""Share of the highest column, in the mean over the projections, that passes for air."""
BODY = 0.2
"""Share of a projection's highest column from which on a column shows the body of the object."""
END = 5
"""Columns whose mean tells where a projection ends."""


@dataclass(frozen=True)
class Radon:
    """The geometry of one set of sinograms: where each projection looks from, and how far."""

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column of the rotation axis, px."""
    n_columns: int
    """Detector columns."""
    size: int
    """Pixels along the side of a slice; its middle ``(size - 1) / 2`` lies on the axis."""

    def project(self, slices: Pixels) -> Pixels:
        """Line integrals (r, n, column) of `slices` (r, z, x)."""
        return self._detector(self._radial_lines(slices))

    def derivative(self, slices: Pixels) -> Pixels:
        """Return the derivative of `project` by each angle: (r, n, column), per radian.

        ``dp/dtheta`` has the spectrum ``-2 pi i f (cos(theta) F[Z s] - sin(theta) F[X s])``.
        """
        along = (np.arange(self.size) - (self.size - 1) / 2).astype(np.float32)
        by_x = self._radial_lines(slices * along)
        by_z = self._radial_lines(slices * along[:, None])
        cosine, sine = np.cos(self.theta)[:, None], np.sin(self.theta)[:, None]
        return self._detector(-2j * np.pi * self._frequencies * (cosine * by_z - sine * by_x))

    def linearised(self, slices: Pixels) -> tuple[Pixels, Pixels, Pixels]:
        """Return `project` and its derivatives by each angle and by the axis, (r, n, column) each.

        From one transform a little to either side of each angle: two for all three, and to about
        a hundredth as exact as `derivative`, per radian and per px.
        """
        sides = self._sides
        lines = sides._radial_lines(slices) * sides._shift
        before, after = np.split(lines, 2, axis=1)
        middle = (before + after) / 2
        turned = (after - before) / np.float32(2 * ASIDE)
        along = middle * (-2j * np.pi * self._frequencies).astype(np.complex64)
        return self._columns(middle), self._columns(turned), self._columns(along)

    def adjoint(self, sinograms: Pixels) -> Pixels:
        """Unfiltered back-projection (r, z, x) of `sinograms` (r, n, column)."""
        return self._spread(rfft(sinograms, self._length, axis=-1))

    def fbp(self, sinograms: Pixels, window: Window = "hann") -> Pixels:
        """Return slices (r, z, x), per pixel: `sinograms` (r, n, column) filtered and spread.

        The ramp is the discrete one of Ram and Lak; each projection weighs as much as the angle
        it stands for (`angular_weights`); ends of truncated projections are tapered off.
        """
        before = (self._length - self.n_columns) // 2
        padded = tapered(sinograms, before, self._length)
        back = np.exp(2j * np.pi * self._frequencies * before) * ramp(self._length, window)
        filtering = np.outer(angular_weights(self.theta), back).astype(np.complex64)
        return self._spread(rfft(padded, axis=-1) * filtering)

    def disc(self) -> NDArray[np.bool_]:
        """(z, x) pixels that every projection sees, were the axis in the middle."""
        along = np.arange(self.size) - (self.size - 1) / 2
        return np.asarray(np.hypot(along[:, None], along) <= self.size / 2 - 1)

    @cached_property
    def _sides(self) -> Radon:
        """The same, looking from `ASIDE` before each angle, then from `ASIDE` after each."""
        return replace(self, theta=np.concatenate([self.theta - ASIDE, self.theta + ASIDE]))

    @cached_property
    def _length(self) -> int:
        """Columns of the padded projections: wide enough that nothing wraps round."""
        return int(next_fast_len(2 * max(self.n_columns, self.size), real=True) // 2 * 2)

    @cached_property
    def _frequencies(self) -> Floats:
        """(f,) cycles per pixel."""
        return np.fft.rfftfreq(self._length).astype(np.float64)

    @cached_property
    def _points(self) -> tuple[Pixels, Pixels]:
        """(n f,) radians per pixel along z and x: the samples of the radial lines."""
        radial = 2 * np.pi * self._frequencies
        along_z = np.outer(np.sin(self.theta), radial).ravel()
        along_x = np.outer(np.cos(self.theta), radial).ravel()
        return along_z.astype(np.float32), along_x.astype(np.float32)

    @cached_property
    def _shift(self) -> Spectrum:
        """(n, f) phase that moves a slice's middle pixel to the axis' detector column."""
        off = self.size // 2 - (self.size - 1) / 2
        offset = self.axis + off * (np.cos(self.theta) + np.sin(self.theta))
        cycles = np.outer(offset, self._frequencies)
        return np.asarray(np.exp(-2j * np.pi * cycles), np.complex64)

    @cached_property
    def _margin(self) -> int:
        """Px added around a slice, so that the transforms run on a grid that suits the cache.

        A fine grid whose side is a multiple of a large power of two takes up to three times as
        long.
        """
        return next(k for k in range(64) if fine_grid(self.size + 2 * k) % SLOW_SIDE)

    def _plan(self, kind: int, count: int) -> Any:
        """Plan `count` transforms: kind 2 evaluates radial lines, kind 1, its adjoint, spreads."""
        import finufft

        sign = -1 if kind == 2 else 1
        shape = (self.size + 2 * self._margin,) * 2
        plan = finufft.Plan(kind, shape, count, ACCURACY, sign, dtype="complex64", nthreads=1)
        plan.setpts(*self._points)
        return plan

    def _radial_lines(self, slices: Pixels) -> Spectrum:
        """(r, n, f) Fourier transform of `slices` (r, z, x) on the radial lines."""
        around = ((0, 0), (self._margin,) * 2, (self._margin,) * 2)
        wide = np.pad(slices.astype(np.complex64), around)
        lines: Spectrum = self._plan(2, len(slices)).execute(wide)
        return lines.reshape(len(slices), len(self.theta), -1)

    def _detector(self, spectrum: NDArray[Any]) -> Pixels:
        """(r, n, column) what has the `spectrum` (r, n, f), the axis at its column."""
        return self._columns(spectrum * self._shift)

    def _columns(self, spectrum: NDArray[Any]) -> Pixels:
        """(r, n, column) what has the `spectrum` (r, n, f)."""
        projections = irfft(spectrum, self._length, axis=-1)
        return projections[..., : self.n_columns].astype(np.float32)

    def _spread(self, spectrum: NDArray[Any]) -> Pixels:
        """(r, z, x) sum over all frequencies of `spectrum` (r, n, f), of which half are stored."""
        both = np.full(len(self._frequencies), 2 / self._length, np.float32)
        both[[0, -1]] = 1 / self._length
        weighted = (spectrum * (self._shift.conj() * both)).astype(np.complex64, copy=False)
        spread = self._plan(1, len(spectrum)).execute(weighted.reshape(len(spectrum), -1))
        inner = slice(self._margin, self._margin + self.size)
        return np.ascontiguousarray(spread.real[:, inner, inner], dtype=np.float32)


def fine_grid(size: int) -> int:
    """Side of the grid, twice oversampled, that transforms of `size` px run on inside finufft."""
    return 2 * int(next_fast_len(size, real=True))


def reach_beyond(sinograms: Pixels) -> int:
    """Columns that the object goes on for beyond either end of `sinograms` (r, n, column).

    None where both ends show air. Otherwise as far as what `continued` adds is more than `FAINT`,
    in the mean over the projections, which noise does not move.
    """
    columns = sinograms.shape[-1]
    mean = sinograms.mean(axis=1, dtype=np.float64)
    faint = FAINT * mean.max(axis=-1, keepdims=True)
    ends = np.stack([mean[:, :END].mean(axis=-1), mean[:, -END:].mean(axis=-1)], axis=-1)
    if not (ends > faint).any():
        return 0
    reach = round(REACH * columns)

    def added(block: Pixels) -> Floats:
        wide = continued(block, reach).mean(axis=1, dtype=np.float64)
        return np.asarray(np.maximum(wide[:, :reach][:, ::-1], wide[:, -reach:]))

    over = (in_blocks(added, sinograms) > faint).any(axis=0)
    return int(np.flatnonzero(over)[-1]) + 1 if over.any() else 0


def object_reach(sinograms: Pixels, axis: float, beyond: int) -> float:
    """Px from the axis to the farthest column that shows more than `FAINT`.

    Counted from the outermost columns where the object goes on for `beyond` more.
    """
    mean = sinograms.mean(axis=1, dtype=np.float64)
    shown = (mean > FAINT * mean.max(axis=-1, keepdims=True)).any(axis=0)
    if beyond:
        shown[[0, -1]] = True
    distance = np.abs(np.flatnonzero(shown) - axis)
    return float(distance.max(initial=0)) + beyond


def continued(sinograms: Pixels, by: int) -> Pixels:
    """(r, n, column + 2 by) `sinograms` (r, n, column) as if the detector were wider.

    Each end goes on as the chords of an ellipse do, whose squares are a parabola: through the mean
    of the last `END` columns, and otherwise the one that fits the whole projection best. It ends
    within `REACH`. (Hsieh et al., Med. Phys. 31 (2004) 2385, fit a cylinder to the end alone.)
    """
    if by == 0:
        return sinograms
    left = _beyond_the_last(sinograms[..., ::-1])[..., :by][..., ::-1]
    right = _beyond_the_last(sinograms)[..., :by]
    return np.concatenate([left, sinograms, right], axis=-1)


def _beyond_the_last(sinograms: Pixels) -> Pixels:
    """(r, n, column) what follows the last column, until `REACH`."""
    columns = sinograms.shape[-1]
    end = np.maximum(sinograms[..., -END:].mean(axis=-1, keepdims=True, dtype=np.float64), 0)
    middle = -(END - 1) / 2 / columns
    slope, bend = _fitted_parabola(sinograms)
    # Neither rises again, nor is it still there at the end of its reach.
    slope = np.minimum(slope, 0)
    bend = np.minimum(bend, -(end**2) / (REACH**2 - middle**2))
    along = np.arange(1, round(REACH * columns) + 1) / columns
    squares = end**2 + slope * (along - middle) + bend * (along**2 - middle**2)
    return np.asarray(np.sqrt(np.maximum(squares, 0)), np.float32)


def _fitted_parabola(sinograms: Pixels) -> tuple[Floats, Floats]:
    """(r, n, 1) slope at the last column and bend of the squares, in widths of the detector.

    Only columns with more than `BODY` of the highest one count, so that air does not.
    """
    columns = sinograms.shape[-1]
    powers = (np.arange(1.0 - columns, 1.0) / columns)[:, None] ** np.arange(5)
    body = sinograms > BODY * sinograms.max(axis=-1, keepdims=True)
    moments = body.astype(np.float64) @ powers
    normal = moments[..., np.add.outer(np.arange(3), np.arange(3))]
    squares = np.where(body, sinograms, 0).astype(np.float64) ** 2 @ powers[:, :3]
    # The ridge is for projections that show nothing; it moves no others.
    fit = np.linalg.solve(normal + 1e-9 * columns * np.eye(3), squares[..., None])
    return fit[..., 1, :], fit[..., 2, :]
