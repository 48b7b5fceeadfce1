"""Some projections round the turn, and the tracks that run over them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.comparison.page.charts import items
from tomoslam_stage.comparison.page.packing import jpeg, packed, rounded, shrunk
from tomoslam_stage.geometry import around

if TYPE_CHECKING:
    from tomoslam_stage.comparison.findings import Findings
    from tomoslam_stage.products import Floats, Integers, Tracks

FRAMES = 60
WIDEST, HIGHEST = 400, 320
"""px of a projection on the page."""
MOST_SIGHTINGS = 40_000
"""Of more only every so many-th feature is drawn."""
TAIL_DEG = 12.0
"""How much of the turn a track is drawn over."""


def movie(findings: Findings) -> dict[str, Any]:
    """Projections evenly chosen in the order of the angles, read one by one; their sightings."""
    scan, theta = findings.scan, findings.refinement.recorded
    order = around(theta)
    chosen = np.unique(np.linspace(0, len(order) - 1, min(FRAMES, len(order))).astype(np.intp))
    factor = max(-(-scan.n_columns // WIDEST), -(-scan.n_rows // HIGHEST))
    factor = min(factor, scan.n_columns, scan.n_rows)
    images = [shrunk(scan.projection(int(order[k])), factor, factor) for k in chosen]
    seen = np.concatenate([image[np.isfinite(image)] for image in images])
    limits = tuple(float(v) for v in np.percentile(seen, (0.5, 99.5))) if seen.size else (0.0, 1.0)
    low, high = limits if limits[0] < limits[1] else (limits[0] - 0.5, limits[0] + 0.5)
    step = float(np.median(np.diff(np.sort(np.mod(theta, 2 * np.pi))))) if len(theta) > 1 else 1.0
    return {
        "frames": [jpeg(image, (low, high)) for image in images],
        "width": images[0].shape[1],
        "height": images[0].shape[0],
        "ranks": chosen.tolist(),
        "names": [items(findings)[k] for k in order[chosen]],
        "angles": rounded(np.degrees(theta[order[chosen]])),
        "tail": int(np.clip(np.radians(TAIL_DEG) / max(step, 1e-9), 2, len(order))),
        "tracks": tracks_of(findings, order, factor),
    }


def tracks_of(findings: Findings, order: Integers, factor: int) -> dict[str, Any] | None:
    """Sightings sorted by feature and by the order of the angles, in px of the movie.

    None where features were not followed.
    """
    tracks = findings.tracks
    if tracks is None or not tracks.n_sightings:
        return None
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    _, feature = np.unique(tracks.feature, return_inverse=True)
    every = -(-tracks.n_sightings // MOST_SIGHTINGS)
    drawn = np.flatnonzero(feature % every == 0)
    drawn = drawn[np.lexsort((rank[tracks.projection[drawn]], feature[drawn]))]
    column, row = ((p[drawn] - (factor - 1) / 2) / factor for p in (tracks.column, tracks.row))
    residual = residuals_of(findings, tracks)
    return {
        "features": tracks.n_features,
        "sightings": tracks.n_sightings,
        "every": every,
        "feature": packed(feature[drawn].astype(np.int32)),
        "rank": packed(rank[tracks.projection[drawn]].astype(np.int32)),
        "column": packed(column.astype(np.float32)),
        "row": packed(row.astype(np.float32)),
        "residual": None if residual is None else packed(residual[drawn].astype(np.float32)),
    }


def residuals_of(findings: Findings, tracks: Tracks) -> Floats | None:
    """(s,) px, how far each sighting lies from where it was expected; None where nobody looked."""
    residual = findings.refinement.histograms.get("sighting_residuals", np.empty(0))
    return residual if len(residual) == tracks.n_sightings else None
