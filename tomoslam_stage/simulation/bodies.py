"""Bodies whose shadows have a closed form: ellipsoid, box, cylinder and Gaussian blob.

Every body is the affine image of a unit body. A point p of space has the body's own coordinates
``q_i = axis_i . (p - centre) / half_i``, and a ray that leaves the detector at (x, y) from the
body's middle runs along ``q = local @ (x, y, w)``, w being the way along the beam. What is left
are the chords of a unit sphere, cube, cylinder and Gaussian, in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tomoslam_stage.products import Floats

BLOB_REACH = 6.0
"""Standard deviations after which a blob is cut off; 1.5e-8 of its middle is left there."""

GRAZING = 1e-9
"""A ray parallel to a face is turned by this much: the same chord, and no division by zero."""


class Body(Protocol):
    """A unit body: how far it reaches, how it fills space, and how long its chords are."""

    def reach(self, extent: Floats) -> Floats:
        """(n, j) px: half lengths along j directions; `extent` (n, 3, j) are those of each axis."""
        ...

    def fill(self, q: Floats) -> Floats:
        """(m,) share of the density at the own coordinates `q` (3, m)."""
        ...

    def shadow(self, local: Floats) -> Floats:
        """(c, n) the numbers that `chord` needs of each of the n bodies of `local` (n, 3, 3)."""
        ...

    def chord(self, shadow: Floats, x: Floats, y: Floats) -> Floats:
        """(m,) px: chords at `x`, `y` (m,) px from the middle, for `shadow` (c, m)."""
        ...


class Ellipsoid:
    """The unit sphere: its chord is ``peak sqrt(1 - Q(x, y))``."""

    def reach(self, extent: Floats) -> Floats:
        """(n, j) px: half lengths along j directions."""
        return np.asarray(np.linalg.norm(extent, axis=1))

    def fill(self, q: Floats) -> Floats:
        """(m,) one inside, zero outside."""
        return np.asarray((q**2).sum(axis=0) <= 1, dtype=np.float64)

    def shadow(self, local: Floats) -> Floats:
        """(4, n) the quadratic form Q (xx, xy, yy) and the longest chord, px."""
        return np.stack([*_ellipse(local), 2 / np.linalg.norm(local[..., 2], axis=1)])

    def chord(self, shadow: Floats, x: Floats, y: Floats) -> Floats:
        """(m,) px: chords at `x`, `y`."""
        *ellipse, peak = shadow
        return np.asarray(peak * np.sqrt(np.maximum(1 - _form(ellipse, x, y), 0)))


class Blob:
    """The Gaussian ``exp(-q^2 / 2)``: `half` are its standard deviations; no edge anywhere."""

    def reach(self, extent: Floats) -> Floats:
        """(n, j) px: half lengths along j directions."""
        return np.asarray(BLOB_REACH * np.linalg.norm(extent, axis=1))

    def fill(self, q: Floats) -> Floats:
        """(m,) share of the density of the middle."""
        return np.asarray(np.exp(-(q**2).sum(axis=0) / 2))

    def shadow(self, local: Floats) -> Floats:
        """(4, n) the quadratic form Q (xx, xy, yy) and the integral through the middle, px."""
        peak = np.sqrt(2 * np.pi) / np.linalg.norm(local[..., 2], axis=1)
        return np.stack([*_ellipse(local), peak])

    def chord(self, shadow: Floats, x: Floats, y: Floats) -> Floats:
        """(m,) px: integrals of the Gaussian at `x`, `y`."""
        *ellipse, peak = shadow
        return np.asarray(peak * np.exp(-_form(ellipse, x, y) / 2))


class Box:
    """The unit cube ``max |q_i| <= 1``: its chord is what three slabs have in common."""

    def reach(self, extent: Floats) -> Floats:
        """(n, j) px: half lengths along j directions."""
        return np.asarray(extent.sum(axis=1))

    def fill(self, q: Floats) -> Floats:
        """(m,) one inside, zero outside."""
        return np.asarray(np.abs(q).max(axis=0) <= 1, dtype=np.float64)

    def shadow(self, local: Floats) -> Floats:
        """(9, n) for each slab: middle per x and per y, half length; px along the beam."""
        slabs = [_slab(local[:, i]) for i in range(3)]
        return np.concatenate(slabs)

    def chord(self, shadow: Floats, x: Floats, y: Floats) -> Floats:
        """(m,) px: chords at `x`, `y`."""
        first, last = _crossing(shadow[:3], x, y)
        for slab in (shadow[3:6], shadow[6:]):
            enters, leaves = _crossing(slab, x, y)
            np.maximum(first, enters, out=first)
            np.minimum(last, leaves, out=last)
        return np.asarray(np.maximum(last - first, 0))


class Cylinder:
    """The unit cylinder ``q_0^2 + q_1^2 <= 1, |q_2| <= 1``: its third axis is its own."""

    def reach(self, extent: Floats) -> Floats:
        """(n, j) px: half lengths along j directions."""
        return np.asarray(np.hypot(extent[:, 0], extent[:, 1]) + extent[:, 2])

    def fill(self, q: Floats) -> Floats:
        """(m,) one inside, zero outside."""
        return np.asarray((np.hypot(q[0], q[1]) <= 1) & (np.abs(q[2]) <= 1), dtype=np.float64)

    def shadow(self, local: Floats) -> Floats:
        """(8, n) the slab between the ends; middle, distance from the axis and half length."""
        across = local[:, :2]
        beam = _never_grazing(across[..., 2])
        square = (beam**2).sum(axis=1)
        along = -np.einsum("nij,ni->jn", across[..., :2], beam) / square
        turned = np.stack([-beam[:, 1], beam[:, 0]], axis=1) / np.sqrt(square)[:, None]
        aside = np.einsum("nij,ni->jn", across[..., :2], turned)
        return np.concatenate([_slab(local[:, 2]), along, aside, [1 / np.sqrt(square)]])

    def chord(self, shadow: Floats, x: Floats, y: Floats) -> Floats:
        """(m,) px: chords at `x`, `y`."""
        first, last = _crossing(shadow[:3], x, y)
        along_x, along_y, aside_x, aside_y, longest = shadow[3:]
        aside = aside_x * x + aside_y * y
        half = longest * np.sqrt(np.maximum(1 - aside**2, 0))
        middle = along_x * x + along_y * y
        np.maximum(first, middle - half, out=first)
        np.minimum(last, middle + half, out=last)
        return np.asarray(np.maximum(last - first, 0))


@dataclass(frozen=True)
class Solids:
    """Solids of one kind; those of one list add up where they overlap."""

    body: Body
    """What kind they are."""
    centre: Floats
    """(n, 3) px: X, Y, Z from the middle of the rotation axis; Y points down like the rows."""
    axes: Floats
    """(n, 3, 3) their own three axes, a unit vector (X, Y, Z) in each row."""
    half: Floats
    """(n, 3) px: half lengths along their own axes."""
    density: Floats
    """(n,) attenuation per px; negative for a hole in something else."""

    def scaled(self, factor: float) -> Solids:
        """Make them `factor` times larger; their shadows stay as dark as they were."""
        return Solids(
            self.body,
            self.centre * factor,
            self.axes,
            self.half * factor,
            self.density / factor,
        )

    def moved(self, turn: Floats, shift: Floats) -> Solids:
        """Turn them about the origin by the rotation `turn` (3, 3), then add `shift` (3,) px."""
        centre, axes = self.centre @ turn.T + shift, self.axes @ turn.T
        return Solids(self.body, centre, axes, self.half, self.density)

    def chosen(self, mask: NDArray[np.bool_]) -> Solids:
        """Return the solids where `mask` (n,) holds."""
        return Solids(
            self.body, self.centre[mask], self.axes[mask], self.half[mask], self.density[mask]
        )

    def local(self, frame: Floats) -> Floats:
        """(n, 3, 3) own coordinates per px along the three directions of `frame` (rows)."""
        return np.asarray(self.axes @ frame.T / self.half[..., None])

    def reach(self, frame: Floats) -> Floats:
        """(n, 3) px: half lengths along the three directions of `frame` (rows)."""
        return self.body.reach(np.abs(self.axes @ frame.T) * self.half[..., None])


def _ellipse(local: Floats) -> Floats:
    """(3, n) xx, xy, yy of the squared distance of a ray from the middle of the unit sphere."""
    x, y, beam = np.moveaxis(local, 2, 0)
    beam = beam / np.linalg.norm(beam, axis=1, keepdims=True)
    x, y = (side - (side * beam).sum(axis=1, keepdims=True) * beam for side in (x, y))
    return np.stack([(x * x).sum(axis=1), 2 * (x * y).sum(axis=1), (y * y).sum(axis=1)])


def _form(ellipse: list[Floats], x: Floats, y: Floats) -> Floats:
    xx, xy, yy = ellipse
    return (xx * x + xy * y) * x + yy * y * y


def _slab(coordinate: Floats) -> Floats:
    """(3, n) where a ray crosses ``|q| <= 1``: middle per x and y, half length, px."""
    x, y, beam = coordinate.T
    beam = _never_grazing(beam)
    return np.stack([-x / beam, -y / beam, 1 / np.abs(beam)])


def _crossing(slab: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    per_x, per_y, half = slab
    middle = per_x * x + per_y * y
    return middle - half, middle + half


def _never_grazing(beam: Floats) -> Floats:
    return np.where(np.abs(beam) < GRAZING, GRAZING, beam)
