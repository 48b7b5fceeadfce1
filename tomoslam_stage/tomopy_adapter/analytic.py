"""Filtered back-projection and gridrec: tomopy's loops between our filter and our geometry.

tomopy's ``fbp`` back-projects without a filter, its ``gridrec`` takes angles to be equally spaced.
So both get projections that are filtered, weighted and resampled about the axis already, and
neither needs to know where the axis was on the detector. Both count rows upwards; they are given
``-theta`` for that, which makes ``u = X cos(theta) + Z sin(theta)`` ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import pro_ang1

from tomoslam_stage.geometry import angular_weights
from tomoslam_stage.images import Window, ramp, tapered
from tomoslam_stage.parallel import in_blocks
from tomoslam_stage.tomopy_adapter.recon import recon, single_threaded

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Pixels

SUBSETS = 2
"""Sets of rays that `fbp` traces, evenly between the columns.

A single set meets some pixels more often than others: on blobs of a few pixels 5 % off the truth;
two 1.5 %, three 0.8 % (tomopy 1.15.2, 180 angles, 64 columns). Time grows with their number.
"""

BANDWIDTH = 7.0
"""C of gridrec's convolvent, the prolate spheroidal wave function of order zero."""
TABLE = 512
"""Samples of that function that gridrec looks up, the nearest one."""
GAIN = 0.559
"""What gridrec makes of 1 in the middle of a slice, when it is not asked to filter.

Measured on discs with tomopy 1.15.2: 0.5587 to 0.5594 for 100 to 500 columns, odd and even, in
padded lengths of 256 to 1024, 180 to 720 angles, with and without a window. It follows from the
code, 4 pi^2 / (1.2 C)^2 = 0.5595: gridrec cuts its convolvent off at 2 samples of the spectrum,
divides by what one of C / pi = 2.23 would have done, and by 1.2 squared. The rest of what this
does grows towards the edge, see `roll_off`.
"""


def fbp(sinograms: Pixels, theta: Floats, axis: float, window: Window) -> Pixels:
    """Return slices (r, z, x), per pixel, by filtered back-projection along tomopy's rays.

    Rays through square pixels blur by the shadow of the pixel; the filter makes up for it.

    Parameters
    ----------
    sinograms
        (r, n, column) line integrals.
    theta
        (n,) radians.
    axis
        Detector column of the rotation axis, px.
    window
        Apodisation of the ramp.
    """
    size = sinograms.shape[-1]
    length = int(next_fast_len(2 * size, real=True)) // 2 * 2
    columns = size + 2 * int(np.ceil((np.sqrt(2) - 1) / 2 * size))  # up to the corners
    frequencies = np.fft.rfftfreq(length)
    shadow = np.sinc(np.outer(np.cos(theta), frequencies))
    shadow *= np.sinc(np.outer(np.sin(theta), frequencies))
    response = ramp(length, window) / shadow

    def back_project(block: Pixels) -> Pixels:
        slices = np.zeros((len(block), size, size), np.float32)
        for shift in (np.arange(SUBSETS) + 0.5) / SUBSETS - 0.5:
            first = np.full(len(theta), axis - (columns - 1) / 2 + shift)
            filtered = resampled(block, theta, first, response)[..., :columns]
            filtered = np.asarray(filtered / SUBSETS, np.float32)
            recon(filtered, -theta, columns / 2 - shift, slices, algorithm="fbp")
        return slices

    with single_threaded():
        return in_blocks(back_project, sinograms, "FBP")


def gridrec(sinograms: Pixels, theta: Floats, axis: float, window: Window) -> Pixels:
    """Return slices (r, z, x), per pixel, by tomopy's regridding; parameters as of `fbp`.

    Marone and Stampanoni, J. Synchrotron Rad. 19 (2012) 1029. Projections are padded to twice their
    width, else the slice wraps round. gridrec's axis lies on a pixel, which for an even width is
    half a pixel from the middle of the slice: the projections are shifted by as much.
    """
    size = sinograms.shape[-1]
    length = max(16, 2 ** int(np.ceil(np.log2(2 * size))))
    off = size // 2 - (size - 1) / 2
    first = axis + off * (np.cos(theta) + np.sin(theta)) - length // 2
    response = np.broadcast_to(ramp(length, window), (len(theta), length // 2 + 1))
    scale = len(theta) / np.pi / GAIN * roll_off(size, length)

    def regrid(block: Pixels) -> Pixels:
        filtered = resampled(block, theta, first, response)
        grid = np.zeros((len(block), *[2 * (size // 2) + 2] * 2), np.float32)
        recon(filtered, -theta, length // 2, grid, algorithm="gridrec", filter_name="none")
        mean = filtered.sum(axis=(1, 2)) / length  # gridrec leaves out frequency zero
        cropped = grid[:, :size, 1 : size + 1]
        return np.asarray(cropped * scale + mean[:, None, None], np.float32)

    with single_threaded():
        return in_blocks(regrid, sinograms, "gridrec")


def resampled(sinograms: Pixels, theta: Floats, first: Floats, response: Floats) -> Pixels:
    """Filter and weigh `sinograms`, and shift each projection by a part of a column.

    Parameters
    ----------
    sinograms
        (r, n, column) line integrals.
    theta
        (n,) radians: what each projection weighs.
    first
        (n,) px: detector column that becomes column zero; the columns are a circle.
    response
        (n, f) of the filter, f frequencies of the columns padded to ``2 f - 2``.

    Returns
    -------
    Pixels
        (r, n, 2 f - 2) filtered line integrals.
    """
    length = 2 * (response.shape[-1] - 1)
    before = (length - sinograms.shape[-1]) // 2
    cycles = np.outer(first + before, np.fft.rfftfreq(length))
    factor = response * angular_weights(theta)[:, None] * np.exp(2j * np.pi * cycles)
    spectrum = rfft(tapered(sinograms, before, length), axis=-1)
    return np.asarray(irfft(spectrum * factor.astype(np.complex64), length, axis=-1), np.float32)


def roll_off(size: int, length: int) -> Floats:
    """(z, x) what gridrec's slices lack towards the edge, 1 in the middle.

    Spreading a sample of the spectrum with a convolvent multiplies the slice by the convolvent's
    transform; a prolate function is its own. gridrec divides by the function, looked up one pixel
    aside, and as if it had not been cut off: 18 % too much at the edge. This takes that back.
    """
    pixel = np.arange(size, dtype=np.float64) - size // 2
    transform = prolate(4 * np.pi * pixel / (BANDWIDTH * length))
    half = (length - 1) / 2
    divided = [prolate(np.round(np.abs(pixel + d) * TABLE / half) / TABLE) for d in (-1, 1)]
    return np.outer(divided[0] / transform, divided[1] / transform)


def prolate(x: Floats) -> Floats:
    """Prolate spheroidal wave function of order zero and `BANDWIDTH`, 1 at 0; -1 < x < 1."""
    values = np.asarray(pro_ang1(0, 0, BANDWIDTH, x))[0]
    at_zero = np.asarray(pro_ang1(0, 0, BANDWIDTH, 0.0))[0]
    return np.asarray(values / at_zero, np.float64)
