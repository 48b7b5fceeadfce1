"""Numbers that describe the slices, and the errors of a scan whose true angles are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tomoslam_stage.comparison.edges import widths_of_most_changed
from tomoslam_stage.comparison.frc import RingCorrelation, ring_correlation
from tomoslam_stage.comparison.named import check_comparable, halved, wholes
from tomoslam_stage.comparison.regions import Mask, disc, rms
from tomoslam_stage.comparison.similarity import similarity
from tomoslam_stage.products import (
    Comparison,
    Floats,
    Pixels,
    Reconstruction,
    Reconstructions,
    Refinement,
    Truth,
)

Sharpness: TypeAlias = Callable[[Pixels, Mask], float]
"""Of one slice (z, x), over the pixels where the mask (z, x) holds."""


def total_variation(image: Pixels, inside: Mask) -> float:
    """Mean length of the gradient, attenuation per pixel and px."""
    down = np.diff(image, axis=0, append=image[-1:])
    right = np.diff(image, axis=1, append=image[:, -1:])
    return float(np.mean(np.hypot(down, right)[inside], dtype=np.float64))


def gradient_energy(image: Pixels, inside: Mask) -> float:
    """Mean square of the Sobel gradient (Tenengrad), attenuation per pixel and px, squared."""
    from scipy.ndimage import sobel

    down, right = sobel(image, axis=0) / 8, sobel(image, axis=1) / 8
    return float(np.mean((down**2 + right**2)[inside], dtype=np.float64))


def contrast(image: Pixels, inside: Mask) -> float:
    """Spread of the grey values: their standard deviation, attenuation per pixel."""
    return float(np.std(image[inside], dtype=np.float64))


SHARPNESS: Mapping[str, Sharpness] = {
    "total_variation": total_variation,
    "gradient_energy": gradient_energy,
    "contrast": contrast,
}
"""All sharpness figures by name; a new one is a function above and a line here."""


def compare(
    refinement: Refinement, reconstructions: Reconstructions, truth: Truth | None = None
) -> Comparison:
    """Put the numbers together that compare recorded with refined angles.

    Parameters
    ----------
    refinement
        The angles.
    reconstructions
        By name, of the same rows and size, halves perhaps of fewer rows; may be empty.
    truth
        Where the scan is simulated; it goes into `Comparison.errors` and nowhere else.

    Raises
    ------
    ValueError
        If the slices are not of the same rows and size, or a length is not the number of angles.
    """
    check_lengths(refinement, truth)
    errors = {} if truth is None else errors_against(truth, refinement)
    return replace(compare_slices(reconstructions), errors=errors)


def compare_slices(reconstructions: Reconstructions) -> Comparison:
    """Put the numbers together that slices alone tell, see `compare`."""
    made, halves = wholes(reconstructions), halved(reconstructions)
    check_comparable(made)
    check_comparable({n: one for n, one in reconstructions.items() if n not in made})
    rings = {
        name: ring_correlation(even.slices, odd.slices) for name, (even, odd) in halves.items()
    }
    nothing = np.empty(0)
    first = next(iter(rings.values()), RingCorrelation(nothing, nothing, nothing))
    return Comparison(
        sharpness=sharpness(made),
        similarity=similarity(made),
        frc_frequency=first.frequency,
        frc_threshold=first.threshold,
        frc={name: ring.correlation for name, ring in rings.items()},
        frc_resolution_px={name: ring.resolution_px for name, ring in rings.items()},
        edge_width_px=widths_of_most_changed(made),
    )


def check_lengths(refinement: Refinement, truth: Truth | None) -> None:
    """Refuse residuals or true angles of another number of projections.

    Raises
    ------
    ValueError
        If there is not one for each angle.
    """
    lengths = dict(refinement.reprojection)
    if truth is not None:
        lengths["truth"] = truth.theta
    n = refinement.recorded.shape
    for name, values in lengths.items():
        if values.shape != n:
            raise ValueError(f"{name}: {values.shape} values for {n} angles; one each is needed")


def sharpness(reconstructions: Reconstructions) -> dict[str, dict[str, float]]:
    """Metric -> name of the reconstruction -> mean over its slices, all over the same disc."""
    return {
        metric: {name: _mean_over_slices(measure, made) for name, made in reconstructions.items()}
        for metric, measure in SHARPNESS.items()
    }


def _mean_over_slices(measure: Sharpness, made: Reconstruction) -> float:
    if not len(made.slices):
        return float("nan")
    inside = disc(made.slices.shape[1:])
    return float(np.mean([measure(image, inside) for image in made.slices]))


def errors_against(truth: Truth, refinement: Refinement) -> dict[str, float]:
    """Errors of the recorded and the refined angles, whether these are accepted or not.

    Returns
    -------
    ``recorded_rms_deg``, ``refined_rms_deg``
        degrees, rms with the mean removed: a common offset only turns the slices.
    ``recorded_rms_first_fixed_deg``, ``refined_rms_first_fixed_deg``
        degrees, rms with the error of the first angle taken off all, as in the paper.
    ``error_ratio``
        ``recorded / refined`` of the latter: equation 7 of the paper; 1 where both are exact.
    """
    errors = {}
    for name, theta in (("recorded", refinement.recorded), ("refined", refinement.refined)):
        error = np.degrees(difference_of_angles(theta, truth.theta))
        errors[f"{name}_rms_deg"] = rms(error - error.mean())
        errors[f"{name}_rms_first_fixed_deg"] = rms(error - error[0])
    recorded, refined = (errors[f"{n}_rms_first_fixed_deg"] for n in ("recorded", "refined"))
    with np.errstate(divide="ignore"):
        ratio = 1.0 if recorded == refined else float(np.divide(recorded, refined))
    return {**errors, "error_ratio": ratio}


def difference_of_angles(theta: Floats, reference: Floats) -> Floats:
    """(n,) radians: ``theta - reference`` without whole turns between single projections."""
    # Scans in an interlaced order unwrap differently when an error tips a step over half a turn.
    difference = theta - reference
    turns = np.round((difference - np.median(difference)) / (2 * np.pi))
    return np.asarray(difference - 2 * np.pi * turns)
