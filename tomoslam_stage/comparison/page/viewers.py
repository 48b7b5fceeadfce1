"""What the two picture viewers of the page show: slices, and the sinogram of one row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison.findings import row_label
from tomoslam_stage.comparison.named import wholes
from tomoslam_stage.comparison.page.packing import deep, rounded, shrunk
from tomoslam_stage.comparison.regions import disc_radius, grey_limits, most_changed_first
from tomoslam_stage.comparison.slice_pairs import SlicePair, slice_pair
from tomoslam_stage.comparison.slices_picture import panel_titles
from tomoslam_stage.geometry import around
from tomoslam_stage.images import still

if TYPE_CHECKING:
    from tomoslam_stage.comparison.findings import Findings
    from tomoslam_stage.products import Floats, Pixels

MOST_SLICES = 5
MOST_PIXELS = 1_200_000
"""Of all slices together: 2.5 MB of the page."""
LARGEST_DETAIL = 256
"""px: side of what is shown in full where a slice had to be shrunk."""
SINOGRAM = 400, 400
"""Most angles and columns of a sinogram."""


def slices_viewer(findings: Findings) -> dict[str, Any] | None:
    """Slices with each set of angles, the most changed ones where there are many.

    Slices too large for a page are shrunk; the part that changed most is then shown in full.
    """
    made = wholes(findings.reconstructions)
    if not {"recorded", "refined"} <= set(made) or not len(made["recorded"].rows):
        return None
    changed = most_changed_first(made["recorded"].slices, made["refined"].slices)
    chosen = sorted(changed[:MOST_SLICES])
    names = shown_names(findings, list(made))
    height, width = made["recorded"].slices.shape[1:]
    whole = height * width * len(chosen) * len(names)
    factor = int(np.ceil(np.sqrt(max(whole / MOST_PIXELS, 1))))
    pairs = [slice_pair(findings, index) for index in chosen]
    titles = panel_titles(pairs[0], findings.refinement.status)
    return {
        "names": {name: titles[name] for name in names},
        "stacks": [slice_stack(pair, names, factor) for pair in pairs],
        "first": chosen.index(changed[0]),
        "axes": ["x / px", "z / px"],
        "unit": "attenuation / px",
    }


def shown_names(findings: Findings, made: list[str]) -> list[str]:
    """Leave out refined slices that are the recorded ones: there is nothing to compare."""
    return [name for name in made if name != "refined" or findings.refinement.change.any()]


def slice_stack(pair: SlicePair, names: list[str], factor: int) -> dict[str, Any]:
    """Pack one slice with all sets of angles, on one scale."""
    images = {name: pair.images[name] for name in names}
    values = np.stack(list(images.values()))[:, pair.inside]
    values = values[np.isfinite(values)]
    limits = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    limits = limits if limits[0] < limits[1] else pair.limits
    height, width = pair.inside.shape
    small = {name: shrunk(image, factor, factor) for name, image in images.items()}
    return {
        "label": pair.label,
        **layers(small, limits),
        "window": rounded(pair.limits),
        "pixel": [factor, factor],
        "origin": [0, 0],
        "circle": [(width - 1) / 2, (height - 1) / 2, disc_radius((height, width))],
        "focus": [pair.window.left, pair.window.top, pair.window.side]
        if "refined" in names
        else None,
        "detail": detail(pair, images, limits) if factor > 1 else None,
    }


def layers(images: Mapping[str, Pixels], limits: tuple[float, float]) -> dict[str, Any]:
    """Size, scale and pixels of `images` (row, column) of one size."""
    height, width = next(iter(images.values())).shape
    return {
        "width": width,
        "height": height,
        "limits": list(limits),
        "layers": {name: deep(image, limits) for name, image in images.items()},
    }


def detail(
    pair: SlicePair, images: Mapping[str, Pixels], limits: tuple[float, float]
) -> dict[str, Any]:
    """Pack the part that changed most in full, around the middle of its window."""
    height, width = pair.inside.shape
    side = min(LARGEST_DETAIL, height, width)
    middle = pair.window.side // 2
    top = int(np.clip(pair.window.top + middle - side // 2, 0, height - side))
    left = int(np.clip(pair.window.left + middle - side // 2, 0, width - side))
    cut = {name: one[top : top + side, left : left + side] for name, one in images.items()}
    return {**layers(cut, limits), "pixel": [1, 1], "origin": [left, top]}


def sinogram_viewer(findings: Findings) -> dict[str, Any] | None:
    """One row: what slices from either angles leave of it, and its sinogram placed by angle.

    A row that was not used where there is one, else that of the middle slice. None where nothing
    was refined: the two would be the same picture.
    """
    from tomoslam_stage.reprojection import Reprojection

    scan, refinement = findings.scan, findings.refinement
    axes = [refinement.axes.get(name, np.nan) for name in ("recorded", "refined")]
    finite = np.isfinite(axes).all() and np.isfinite(refinement.refined).all()
    if not (refinement.change.any() and finite and scan.n_projections > 1):
        return None
    row = row_shown(findings)
    sinogram = scan.sinograms(np.array([row]))
    geometry = {
        "recorded": (sinogram, refinement.recorded, axes[0]),
        "refined": (still(sinogram, refinement.shift), refinement.refined, axes[1]),
    }
    order = around(refinement.recorded - refinement.recorded.min())
    left = {
        name: Reprojection().left(seen, theta, axis)[0, order]
        for name, (seen, theta, axis) in geometry.items()
    }
    placed = {name: by_angle(seen[0], theta) for name, (seen, theta, _) in geometry.items()}
    unused = "a row that was not used" if row in refinement.heldout_rows else "a row that was used"
    return {
        "names": {"recorded": "recorded angles", "refined": "refined angles"},
        "row": f"{row_label(row, scan.binning)}, {unused}",
        "stacks": [
            sinogram_stack("unexplained by the slice", left, symmetric=True),
            sinogram_stack("sinogram, placed by angle", placed, symmetric=False),
        ],
        "first": 0,
        "axes": ["detector column / px", "projection, in the order of the angles"],
        "unit": "line integral",
    }


def row_shown(findings: Findings) -> int:
    """Choose the row of the sinogram: unused, near the slice that changed most."""
    made = wholes(findings.reconstructions)
    wanted = findings.scan.n_rows // 2
    if {"recorded", "refined"} <= set(made) and len(made["recorded"].rows):
        first = most_changed_first(made["recorded"].slices, made["refined"].slices)[0]
        wanted = int(made["recorded"].rows[first])
    unused = findings.refinement.heldout_rows
    return int(unused[np.argmin(np.abs(unused - wanted))]) if len(unused) else wanted


def by_angle(sinogram: Pixels, theta: Floats) -> Pixels:
    """(n, column) `sinogram` (n, column) at evenly spaced angles, from those between them."""
    order = np.argsort(theta, kind="stable")
    steps = np.arange(len(theta), dtype=np.float64)
    at = np.linspace(theta[order[0]], theta[order[-1]], len(theta))
    place = np.interp(at, theta[order], steps)
    below = np.minimum(place.astype(np.intp), len(theta) - 2)
    share = (place - below)[:, None].astype(np.float32)
    lines = sinogram[order]
    return np.asarray(lines[below] * (1 - share) + lines[below + 1] * share)


def sinogram_stack(label: str, images: Mapping[str, Pixels], *, symmetric: bool) -> dict[str, Any]:
    """Pack sinograms (n, column) of one row on one scale, zero in its middle if `symmetric`."""
    height, width = next(iter(images.values())).shape
    rows, columns = -(-height // SINOGRAM[0]), -(-width // SINOGRAM[1])
    small = {name: shrunk(image, rows, columns) for name, image in images.items()}
    all_of = np.stack(list(small.values()))
    everywhere = np.ones(all_of.shape[1:], bool)
    low, high = grey_limits(all_of, everywhere)
    if symmetric:
        low, high = -max(-low, high), max(-low, high)
    limits = float(min(low, all_of.min())), float(max(high, all_of.max()))
    return {
        "label": label,
        **layers(small, limits),
        "window": rounded((low, high)),
        "pixel": [columns, rows],
        "origin": [0, 0],
        "circle": None,
        "focus": None,
        "detail": None,
    }
