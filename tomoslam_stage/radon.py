"""The parallel-beam projector, its derivative, its adjoint and filtered back-projection.

All four evaluate or spread the two-dimensional Fourier transform of a slice on the radial lines of
the projection-slice theorem, through the non-uniform fast Fourier transform (Barnett, Magland and
af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479). Any angles and any axis are as good as any
other, and the derivative with respect to the angle is analytic.

Every transform runs on one thread, so that results do not depend on the number of workers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels

Window: TypeAlias = Literal["ram-lak", "shepp-logan", "hann"]
Spectrum: TypeAlias = NDArray[np.complex64]

ACCURACY = 1e-5
"""Relative error of the transforms; single precision allows little more."""


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
        spectrum = rfft(padded, axis=-1) * np.exp(2j * np.pi * self._frequencies * before)
        weights = angular_weights(self.theta)[:, None]
        return self._spread(spectrum * (weights * ramp(self._length, window)))

    def disc(self) -> NDArray[np.bool_]:
        """(z, x) pixels that every projection sees, were the axis in the middle."""
        along = np.arange(self.size) - (self.size - 1) / 2
        return np.asarray(np.hypot(along[:, None], along) <= self.size / 2 - 1)

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

    def _plan(self, kind: int, count: int) -> Any:
        """Plan `count` transforms: kind 2 evaluates radial lines, kind 1, its adjoint, spreads."""
        import finufft

        sign = -1 if kind == 2 else 1
        shape = (self.size, self.size)
        plan = finufft.Plan(kind, shape, count, ACCURACY, sign, dtype="complex64", nthreads=1)
        plan.setpts(*self._points)
        return plan

    def _radial_lines(self, slices: Pixels) -> Spectrum:
        """(r, n, f) Fourier transform of `slices` (r, z, x) on the radial lines."""
        lines: Spectrum = self._plan(2, len(slices)).execute(slices.astype(np.complex64))
        return lines.reshape(len(slices), len(self.theta), -1)

    def _detector(self, spectrum: NDArray[Any]) -> Pixels:
        """(r, n, column) what has the `spectrum` (r, n, f), the axis at its column."""
        projections = irfft(spectrum * self._shift, self._length, axis=-1)
        return projections[..., : self.n_columns].astype(np.float32)

    def _spread(self, spectrum: NDArray[Any]) -> Pixels:
        """(r, z, x) sum over all frequencies of `spectrum` (r, n, f), of which half are stored."""
        both = np.full(len(self._frequencies), 2 / self._length, np.float32)
        both[[0, -1]] = 1 / self._length
        weighted = (spectrum * self._shift.conj() * both).astype(np.complex64)
        spread = self._plan(1, len(spectrum)).execute(weighted.reshape(len(spectrum), -1))
        return np.ascontiguousarray(spread.real, dtype=np.float32)


def angular_weights(theta: Floats) -> Floats:
    """(n,) radians: the share of the half turn that each projection stands for.

    Half the gap to either neighbour, modulo a half turn; the weights add up to pi.
    """
    folded = np.mod(theta, np.pi)
    order = np.argsort(folded, kind="stable")
    gaps = np.diff(folded[order], append=folded[order[0]] + np.pi)
    weights = np.empty_like(folded)
    weights[order] = (gaps + np.roll(gaps, 1)) / 2
    return weights


def ramp(length: int, window: Window) -> Floats:
    """(length // 2 + 1,) the discrete ramp of Ram and Lak, times a window.

    Kak and Slaney, Principles of Computerized Tomographic Imaging (1988), equation 3-61.
    """
    column = np.minimum(np.arange(length), length - np.arange(length))
    kernel = np.zeros(length)
    kernel[0] = 0.25
    odd = column % 2 == 1
    kernel[odd] = -1 / (np.pi * column[odd]) ** 2
    frequencies = np.fft.rfftfreq(length)
    windows: dict[Window, Floats] = {
        "ram-lak": np.ones_like(frequencies),
        "shepp-logan": np.sinc(frequencies),
        "hann": 0.5 + 0.5 * np.cos(2 * np.pi * frequencies),
    }
    return np.asarray(rfft(kernel).real * windows[window])


def tapered(sinograms: Pixels, before: int, length: int) -> Pixels:
    """Pad the columns to `length`, `before` of them on the left, the end values falling to zero."""
    after = length - before - sinograms.shape[-1]
    padded = np.pad(sinograms, ((0, 0), (0, 0), (before, after)), mode="edge")
    padded[..., :before] *= 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, before, endpoint=False))
    padded[..., length - after :] *= 0.5 + 0.5 * np.cos(np.linspace(0, np.pi, after + 1))[1:]
    return padded
