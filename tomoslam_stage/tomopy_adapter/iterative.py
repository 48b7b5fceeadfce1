"""What tomopy reconstructs by iteration, along rays through square pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.parallel import parallel
from tomoslam_stage.tomopy_adapter.recon import recon, single_threaded

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from tomoslam_stage.products import Floats, Pixels

FAINT = 1e-6
"""What tomopy begins with: some algorithms multiply, and would never leave zero."""


def sirt(
    sinograms: Pixels, theta: Floats, axis: float, iterations: int, nonnegative: bool
) -> Pixels:
    """Return slices (r, z, x), per pixel, by simultaneous iterative reconstruction from zero.

    tomopy has no constraint; each of its iterations starts from what the one before left, and
    between them what is negative is set to zero.

    Parameters
    ----------
    sinograms
        (r, n, column) line integrals.
    theta
        (n,) radians.
    axis
        Detector column of the rotation axis, px.
    iterations
        Times that all projections are used.
    nonnegative
        Whether to set attenuation below zero to zero in every iteration.
    """
    calls, each = (iterations, 1) if nonnegative else (1, iterations)

    def solve(sinogram: Pixels, slices: Pixels) -> None:
        slices[:] = 0
        for _ in range(calls):
            recon(sinogram, -theta, axis + 0.5, slices, algorithm="sirt", num_iter=each)
            if nonnegative:
                np.maximum(slices, 0, out=slices)

    return each_slice(solve, sinograms, axis, "SIRT")


def iterate(
    sinograms: Pixels, theta: Floats, axis: float, algorithm: str, parameters: Mapping[str, Any]
) -> Pixels:
    """Return slices (r, z, x), per pixel, by another of tomopy's algorithms that iterate.

    Parameters
    ----------
    sinograms
        (r, n, column) line integrals.
    theta
        (n,) radians.
    axis
        Detector column of the rotation axis, px.
    algorithm
        Such as ``mlem``.
    parameters
        Of those that `recon_keywords` gives, but for the size of the grid.

    Raises
    ------
    PipelineError
        If ``ind_block`` is no order of the projections.
    """
    chosen = dict(parameters)
    if "reg_par" in chosen:
        chosen["reg_par"] = filled_up(chosen["reg_par"])
    if "ind_block" in chosen:
        chosen["ind_block"] = order_of(len(theta), chosen["ind_block"])

    def solve(sinogram: Pixels, slices: Pixels) -> None:
        slices[:] = FAINT
        # tomopy's own is as large as the detector, not as the grid.
        prior = {"reg_data": np.zeros_like(slices)} if algorithm == "tikh" else {}
        recon(sinogram, -theta, axis + 0.5, slices, algorithm=algorithm, **prior, **chosen)

    return each_slice(solve, sinograms, axis, algorithm)


def filled_up(reg_par: float | Sequence[float]) -> Pixels:
    """(10,) as tomopy's default, whose loops read past the end of a shorter one."""
    given = np.atleast_1d(np.asarray(reg_par, np.float32))
    return np.concatenate([given, np.ones(max(0, 10 - len(given)), np.float32)])


def order_of(count: int, ind_block: Sequence[int]) -> NDArray[np.int32]:
    """(count,) each projection once: tomopy does not look whether that is so."""
    order = np.asarray(ind_block, np.int32)
    if not np.array_equal(np.sort(order), np.arange(count)):
        found = f"{len(order)} numbers; each of 0 to {count - 1} is needed once."
        raise PipelineError("recon.ind_block", found)
    return order


def each_slice(
    solve: Callable[[Pixels, Pixels], None], sinograms: Pixels, axis: float, what: str
) -> Pixels:
    """Slices (r, z, x) that `solve` leaves in an empty grid (1, z, x), one row at a time.

    The grid holds all that the detector sees, also with the axis far off its middle: what lies
    outside a grid would be piled up at its rim.
    """
    columns = sinograms.shape[-1]
    margin = int(np.ceil(abs(axis - (columns - 1) / 2)))
    size, shown = columns + 2 * margin, slice(margin, margin + columns)

    def one(sinogram: Pixels) -> Pixels:
        slices = np.empty((1, size, size), np.float32)
        solve(sinogram[None], slices)
        return slices[:, shown, shown]

    with single_threaded():
        return np.concatenate(list(parallel(one, sinograms, what)))
