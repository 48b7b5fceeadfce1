"""Which of the three kinds of values a scan holds, from what is there."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from tomoslam_stage.errors import ScanError, nearest
from tomoslam_stage.scans.correction import LineIntegrals, Transmission, read_counts
from tomoslam_stage.scans.selection import gather

if TYPE_CHECKING:
    from h5py import File

    from tomoslam_stage.products import Conversion, Pixels
    from tomoslam_stage.scans.contents import Contents
    from tomoslam_stage.scans.correction import Counts

Kind: TypeAlias = Literal["auto", "counts", "transmission", "line_integrals"]

log = logging.getLogger("tomoslam_stage")

SAMPLED_PROJECTIONS = 5
SAMPLED_ROWS = 16
MOST_INTEGRAL = 30.0
"""No detector sees a beam weakened by more than exp(30): larger values are counts."""
MOST_TRANSMISSION = 1.6
"""Noise and phase contrast lift transmission above 1, but hardly further than this."""


def choose_conversion(contents: Contents, file: File, asked: Kind) -> Conversion:
    """Return what turns the file's values into line integrals; the choice is logged.

    Raises
    ------
    ScanError
        If the kind asked for needs flats that are not there, or no kind fits.
    """
    name = contents.path.name
    kind, why = _decide(contents, file, asked)
    log.info("%s: values are taken as %s: %s", name, kind.replace("_", " "), why)
    if kind == "counts":
        return _with_flats(contents, file)
    if kind == "transmission":
        air = air_level(_sampled(contents, file))
        log.info("%s: transmission of air is taken as %.4g", name, air)
        return Transmission(air)
    return LineIntegrals()


def _decide(contents: Contents, file: File, asked: Kind) -> tuple[Kind, str]:
    name = contents.path.name
    if asked not in get_args(Kind):
        raise ScanError(name, f"no kind of values {asked!r}.", nearest(asked, get_args(Kind)))
    if asked == "counts" and contents.flats is None:
        raise ScanError(
            name,
            f"counts need flats, and {_no_flats(contents)}.",
            "Add flats, or pass --set load_scan.kind=transmission.",
        )
    if asked != "auto":
        return asked, "asked for"
    if contents.flats is not None:
        return "counts", f"there are {contents.flats.n_frames} flats"
    return decide_by_values(_sampled(contents, file), contents)


def _with_flats(contents: Contents, file: File) -> Counts:
    counts = read_counts(contents, file)
    log.info(
        "%s: %d flats (%s), %d darks, median beam %.4g counts",
        contents.path.name,
        contents.flats.n_frames if contents.flats else 0,
        "one group" if len(counts.positions) == 1 else "interpolated along the scan",
        contents.darks.n_frames if contents.darks else 0,
        counts.typical_beam,
    )
    return counts


def _no_flats(contents: Contents) -> str:
    """Say in which way there are none."""
    place = contents.places.flats
    if not place:
        return f"no frame of {contents.places.data} is called one"
    return f"{place} {contents.absent.get(place, 'is empty')}"


def _sampled(contents: Contents, file: File) -> Pixels:
    """Read a few projections and rows (p, r, c), unconverted."""
    frames, rows = contents.frames, contents.data.shape[1]
    some = np.unique(np.linspace(0, len(frames) - 1, SAMPLED_PROJECTIONS).astype(np.intp))
    chosen = np.unique(np.linspace(0, rows - 1, SAMPLED_ROWS).astype(np.intp))
    return gather(file[contents.places.data], frames[some], chosen)


def decide_by_values(values: Pixels, contents: Contents) -> tuple[Kind, str]:
    """Tell transmission from line integrals, where there are no flats.

    Beside the object transmission is at its highest, a line integral at its lowest.

    Parameters
    ----------
    values
        (p, r, c) some of the scan, unconverted.
    contents
        What is in the file, for messages.

    Raises
    ------
    ScanError
        If they can be neither.
    """
    name, data = contents.path.name, contents.places.data
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        raise ScanError(name, f"{data} holds no finite value where it was looked at.")
    low, high = np.percentile(finite, [0.5, 99.5])
    if high > MOST_INTEGRAL:
        raise ScanError(
            name,
            f"{data} holds values up to {high:.4g}, which are counts, but there are no flats "
            f"in {contents.places.flats or data}; they are needed.",
            "Add flats, or pass --set load_scan.kind=transmission.",
        )
    between = f"they lie between {low:.3g} and {high:.3g}"
    if low < 0 or high > MOST_TRANSMISSION:
        return "line_integrals", f"there are no flats, and {between}"
    edge, middle = _edge(values), float(np.nanmean(values))
    kind: Kind = "transmission" if edge > middle else "line_integrals"
    return kind, f"there are no flats, {between}, {edge:.3g} at the edges and {middle:.3g} overall"


def air_level(values: Pixels) -> float:
    """Estimate the transmission of air from the outer columns; 1 where the object covers them.

    Parameters
    ----------
    values
        (p, r, c) transmission.
    """
    edge = _edge(values)
    bright = float(np.nanpercentile(values, 95))
    return edge if np.isfinite(edge) and edge > 0.9 * bright > 0 else 1.0


def _edge(values: Pixels) -> float:
    """Return the typical value of the outer columns."""
    width = max(1, values.shape[2] // 32)
    return float(np.nanmedian(np.concatenate([values[..., :width], values[..., -width:]], axis=2)))
