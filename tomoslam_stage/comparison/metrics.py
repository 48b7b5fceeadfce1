"""Numbers that describe the slices, and the errors of a scan whose true angles are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from tomoslam_stage.comparison.regions import Mask, disc, rms
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
    refinement: Refinement,
    reconstructions: Reconstructions,
    residual: Mapping[str, Floats],
    truth: Truth | None = None,
) -> Comparison:
    """Put the numbers together that compare recorded with refined angles.

    Parameters
    ----------
    refinement
        The angles.
    reconstructions
        Of the same rows and size, by name; may be empty.
    residual
        (n,) line integrals, by name: reprojection residual of each projection, rms.
    truth
        Where the scan is simulated; it goes into `Comparison.errors` and nowhere else.

    Raises
    ------
    ValueError
        If the slices are not of the same rows and size, or a length is not the number of angles.
    """
    check_comparable(reconstructions)
    n = refinement.recorded.shape
    lengths = {**residual} if truth is None else {**residual, "truth": truth.theta}
    for name, values in lengths.items():
        if values.shape != n:
            raise ValueError(f"{name}: {values.shape} values for {n} angles; one each is needed")
    errors = {} if truth is None else errors_against(truth, refinement)
    return Comparison(dict(residual), sharpness(reconstructions), errors)


def check_comparable(reconstructions: Reconstructions) -> None:
    """Refuse slices that do not lie over each other.

    Raises
    ------
    ValueError
        If rows or sizes differ.
    """
    kinds = {
        (tuple(made.rows.tolist()), made.slices.shape): name
        for name, made in reconstructions.items()
    }
    if len(kinds) > 1:
        found = "; ".join(f"{name}: rows {rows}, {shape}" for (rows, shape), name in kinds.items())
        raise ValueError(f"slices of the same rows and size are needed, found {found}")


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
