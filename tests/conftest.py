"""What tests of several rooms need: an object known in closed form, tomopy gone or stood in for."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tomoslam_stage.products import Floats, Pixels
from tomoslam_stage.simulation import SimulatedScan
from tomoslam_stage.stages import preparing
from tomoslam_stage.tomopy_adapter import installed


@dataclass(frozen=True)
class Blobs:
    """Round Gaussian blobs in a few slices, at the same places but of other heights in each."""

    x: Floats
    """(b,) px from the axis."""
    z: Floats
    """(b,) px from the axis."""
    width: Floats
    """(b,) px: standard deviation."""
    height: Floats
    """(r, b) attenuation per px."""

    def slices(self, size: int) -> Pixels:
        """(r, z, x) attenuation per px, the axis in the middle."""
        along = np.arange(size) - (size - 1) / 2
        squared = (along - self.x[:, None, None]) ** 2 + (
            along[:, None] - self.z[:, None, None]
        ) ** 2
        shapes = np.exp(-squared / (2 * self.width[:, None, None] ** 2))
        return np.einsum("rb,bzx->rzx", self.height, shapes).astype(np.float32)

    def sinograms(self, theta: Floats, axis: float, columns: int) -> Pixels:
        """(r, n, column) line integrals."""
        _, shadows = self._shadows(theta, axis, columns)
        return np.einsum("rb,bnc->rnc", self.height, shadows).astype(np.float32)

    def derivative(self, theta: Floats, axis: float, columns: int) -> Pixels:
        """(r, n, column) derivative of the line integrals by the angle, per radian."""
        off, shadows = self._shadows(theta, axis, columns)
        speed = np.outer(self.z, np.cos(theta)) - np.outer(self.x, np.sin(theta))
        slope = shadows * off / self.width[:, None, None] ** 2 * speed[..., None]
        return np.einsum("rb,bnc->rnc", self.height, slope).astype(np.float32)

    def _shadows(self, theta: Floats, axis: float, columns: int) -> tuple[Floats, Floats]:
        """(b, n, column) px from the middle of each blob, and the blob's shadow."""
        middle = np.outer(self.x, np.cos(theta)) + np.outer(self.z, np.sin(theta))
        off = np.arange(columns) - axis - middle[..., None]
        width = self.width[:, None, None]
        return off, width * np.sqrt(2 * np.pi) * np.exp(-(off**2) / (2 * width**2))


@pytest.fixture(scope="session")
def blobs() -> Blobs:
    """Three slices of three blobs without any symmetry, all within 20 px of the axis."""
    return Blobs(
        x=np.array([10.0, -7.0, 13.0]),
        z=np.array([-4.0, 9.0, 12.0]),
        width=np.array([2.0, 3.0, 1.5]),
        height=np.array([[1.0, 0.5, 0.8], [0.2, 0.9, 0.0], [0.0, 0.1, 1.2]]),
    )


@pytest.fixture(scope="session")
def dots() -> Blobs:
    """Two slices of sixty small blobs within 36 px of the axis: texture everywhere."""
    rng = np.random.default_rng(12)
    radius, angle = 36 * np.sqrt(rng.random(60)), rng.uniform(0, 2 * np.pi, 60)
    return Blobs(
        x=radius * np.cos(angle),
        z=radius * np.sin(angle),
        width=rng.uniform(1.0, 2.5, 60),
        height=rng.uniform(0.02, 0.1, (2, 60)),
    )


@pytest.fixture
def fresh_import() -> Iterator[None]:
    """Let the adapter look again whether tomopy is there, and forget afterwards what it saw."""
    installed._tomopy.cache_clear()
    preparing.stage_of.cache_clear()
    yield
    installed._tomopy.cache_clear()
    preparing.stage_of.cache_clear()


@pytest.fixture
def no_tomopy(monkeypatch: pytest.MonkeyPatch, fresh_import: None) -> None:  # noqa: ARG001
    monkeypatch.setitem(sys.modules, "tomopy", None)


def normalize(arr: Any, flat: Any, dark: Any, cutoff: Any = None, ncore: Any = None) -> Any:  # noqa: ARG001
    """Stand in for tomopy's function of this name, and do what it does."""
    dark = dark.mean(axis=0)
    return (arr - dark) / (flat.mean(axis=0) - dark)


def minus_log(arr: Any, ncore: Any = None) -> Any:  # noqa: ARG001
    """Stand in for tomopy's function of this name, and do what it does."""
    return -np.log(arr)


def remove_stripe_based_sorting(tomo: Any, size: Any = None, dim: int = 1) -> Any:  # noqa: ARG001
    """Stand in for tomopy's function of this name: take off what all projections have."""
    return tomo - np.median(tomo, axis=0) + (size or 0)


def remove_outlier(arr: Any, dif: float, size: int = 3, axis: int = 0) -> Any:  # noqa: ARG001
    """Stand in for tomopy's function of this name, and do nothing."""
    return arr


def find_center_vo(tomo: Any, ind: Any = None, smin: int = -50, step: float = 0.25) -> Any:  # noqa: ARG001
    """Stand in for tomopy's function of this name: the middle of what the projections weigh."""
    weight = tomo[:, ind].sum(axis=0)
    return float((weight * np.arange(len(weight))).sum() / weight.sum())


STAND_INS: dict[str, dict[str, Any]] = {
    "tomopy": {"__version__": "stand-in"},
    "tomopy.prep": {},
    "tomopy.prep.normalize": {"normalize": normalize, "minus_log": minus_log},
    "tomopy.prep.stripe": {"remove_stripe_based_sorting": remove_stripe_based_sorting},
    "tomopy.misc": {},
    "tomopy.misc.corr": {"remove_outlier": remove_outlier},
    "tomopy.recon": {},
    "tomopy.recon.rotation": {"find_center_vo": find_center_vo},
    "tomopy.recon.algorithm": {
        "allowed_recon_kwargs": {
            "sirt": ["num_iter", "num_gridx"],
            "gridrec": ["filter_name", "filter_par"],
            "mlem": ["num_iter"],
            "tv": ["num_iter", "reg_par"],
        },
        "allowed_accelerated_kwargs": {},
    },
}
"""Module -> what it holds, where a stand-in takes the place of tomopy."""


@pytest.fixture
def stand_in_functions(monkeypatch: pytest.MonkeyPatch, fresh_import: None) -> None:  # noqa: ARG001
    """Put stand-ins in the place of a few functions of tomopy, whether it is there or not."""
    for path, names in STAND_INS.items():
        module = ModuleType(path)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, path, module)


@pytest.fixture(scope="session")
def flat_fielded() -> Callable[[SimulatedScan], Pixels]:
    """Return what makes line integrals (n, row, column) of the counts of a scan, by hand."""

    def corrected(scan: SimulatedScan) -> Pixels:
        white, dark = scan.whites.mean(axis=0), scan.darks.mean(axis=0)
        light = (np.stack(list(scan.projections())) - dark) / (white - dark)
        return np.asarray(-np.log(np.maximum(light, 1e-3)), np.float32)

    return corrected


@pytest.fixture
def matrices() -> Callable[[Callable[[], object], int], float]:
    """Tell how much memory work needs at most, in matrices of so many by so many numbers."""

    def needed(work: Callable[[], object], size: int) -> float:
        work()  # what is imported, or kept, on the way does not count
        tracemalloc.start()
        try:
            work()
            return tracemalloc.get_traced_memory()[1] / (8 * size**2)
        finally:
            tracemalloc.stop()

    return needed
