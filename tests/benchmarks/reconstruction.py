"""How long every installed backend takes for a slice, and how far it is from the truth.

    python tests/benchmarks/reconstruction.py

Four slices of grains with soft edges, 320 columns, 360 jittered angles, an axis off the middle. The
time is of the second run, on all cores; the error is relative, in the disc that all angles see.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from tomoslam_stage.products import Floats, Pixels
from tomoslam_stage.reconstruction import BACKENDS, Algorithm, Backend, Fbp, Gridrec, Sirt

ROWS, COLUMNS, ANGLES, AXIS = 4, 320, 360, 157.3
ALGORITHMS: dict[str, Algorithm] = {
    "fbp, ram-lak": Fbp(window="ram-lak"),
    "fbp, shepp-logan": Fbp(),
    "gridrec, ram-lak": Gridrec(window="ram-lak"),
    "gridrec, shepp-logan": Gridrec(),
    "sirt, 10 iterations": Sirt(iterations=10),
}


def grains() -> tuple[Floats, Floats, Floats]:
    """(g,) x and z, px from the axis, and the standard deviation of Gaussian grains, px."""
    rng = np.random.default_rng(1)
    radius, angle = 120 * np.sqrt(rng.random(80)), rng.uniform(0, 2 * np.pi, 80)
    return radius * np.cos(angle), radius * np.sin(angle), rng.uniform(2, 8, 80)


def truth() -> Pixels:
    """(r, z, x), all rows the same."""
    x, z, width = grains()
    along = np.arange(COLUMNS) - (COLUMNS - 1) / 2
    by_x = np.exp(-((along - x[:, None]) ** 2) / (2 * width[:, None] ** 2))
    by_z = np.exp(-((along - z[:, None]) ** 2) / (2 * width[:, None] ** 2))
    image = np.einsum("gz,gx->zx", by_z, by_x)
    return np.broadcast_to(image, (ROWS, COLUMNS, COLUMNS)).astype(np.float32)


def sinograms(theta: Floats) -> Pixels:
    """(r, n, column) in closed form."""
    made = np.zeros((len(theta), COLUMNS))
    for x, z, width in zip(*grains(), strict=True):
        middle = AXIS + x * np.cos(theta) + z * np.sin(theta)
        off = np.arange(COLUMNS) - middle[:, None]
        made += width * np.sqrt(2 * np.pi) * np.exp(-(off**2) / (2 * width**2))
    return np.broadcast_to(made, (ROWS, *made.shape)).astype(np.float32)


def measured(backend: Backend, algorithm: Algorithm, theta: Floats) -> tuple[float, float]:
    """Return seconds for a slice, and the relative error."""
    recorded = sinograms(theta)
    backend.reconstruct(algorithm, recorded[:1], theta, AXIS)
    begin = perf_counter()
    found = backend.reconstruct(algorithm, recorded, theta, AXIS).slices
    seconds = (perf_counter() - begin) / ROWS
    along = np.arange(COLUMNS) - (COLUMNS - 1) / 2
    seen = np.hypot(along[:, None], along) < COLUMNS / 2 - 4
    error = np.linalg.norm((found - truth()) * seen) / np.linalg.norm(truth() * seen)
    return seconds, float(error)


if __name__ == "__main__":
    rng = np.random.default_rng(0)
    angles = np.arange(ANGLES) * np.pi / ANGLES + rng.normal(0, 0.2 * np.pi / ANGLES, ANGLES)
    print("algorithm             backend   s / slice  relative error")
    for name, chosen in ALGORITHMS.items():
        for known in BACKENDS.values():
            if why := known.refusal(chosen):
                print(f"{name:21s} {known.name:9s} {why}")
                continue
            seconds, error = measured(known, chosen, angles)
            print(f"{name:21s} {known.name:9s} {seconds:9.3f} {error:15.4f}")
