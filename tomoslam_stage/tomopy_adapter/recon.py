"""tomopy.recon, called so that results do not depend on the number of cores."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.tomopy_adapter.installed import module

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tomoslam_stage.products import Floats, Pixels

THREADS = "TOMOPY_PYTHON_THREADS"


@contextmanager
def single_threaded() -> Iterator[None]:
    """Let each call of tomopy.recon run on the thread that makes it, whichever that is.

    tomopy keeps its number of threads in a variable of the environment, which it deletes after
    each call unless it was there before: calls from several threads would delete it twice.
    """
    before = os.environ.get(THREADS)
    os.environ[THREADS] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[THREADS]
        else:
            os.environ[THREADS] = before


def recon(
    sinograms: Pixels, theta: Floats, center: float, slices: Pixels, **keywords: Any
) -> Pixels:
    """Reconstruct on top of `slices`, which are changed and returned.

    Parameters
    ----------
    sinograms
        (r, n, column) as the algorithm wants them.
    theta
        (n,) radians.
    center
        Column of the axis: that of the pixel's middle for gridrec, of its right edge for others.
    slices
        (r, row, column) what to begin with.
    **keywords
        The algorithm and its parameters.
    """
    reconstructed: Pixels = module("tomopy").recon(
        sinograms,
        np.mod(theta, 2 * np.pi),  # single precision there
        center=center,
        sinogram_order=True,
        init_recon=slices,
        num_gridx=slices.shape[-2],
        num_gridy=slices.shape[-1],
        ncore=1,
        **keywords,
    )
    return reconstructed
