"""tomopy's recon entry: Scan and Refinement -> Reconstructions, through our adapter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from tomoslam_stage import tomopy_adapter
from tomoslam_stage.errors import PipelineError, nearest
from tomoslam_stage.images import Window
from tomoslam_stage.methods import checked, method
from tomoslam_stage.products import Scan
from tomoslam_stage.reconstruction import Algorithm, Fbp, Gridrec, Iterative, Sirt
from tomoslam_stage.stages.reconstructing import Reconstruct
from tomoslam_stage.stages.work import SideOutputs, Work

WINDOWS: Mapping[str, Window] = {
    "none": "ram-lak",
    "ramlak": "ram-lak",
    "shepp": "shepp-logan",
    "cosine": "cosine",
    "hamming": "hamming",
    "hann": "hann",
    "parzen": "parzen",
}
"""tomopy's names of filters -> ours."""
OPTIONS = ("filter_name", "num_iter", "num_block", "ind_block", "reg_par")
"""Parameters that belong to some algorithms only."""


@method
class Recon:
    """Reconstruct with tomopy, from the recorded and from the refined angles."""

    needs: ClassVar = ("scan", "refinement")
    makes: ClassVar = ("reconstructions",)

    algorithm: str
    """tomopy's name of it."""
    center: float | None = None
    """Detector column of the axis, px of the file; by default what suits each set of angles."""
    filter_name: str | None = None
    """Of ``fbp`` and ``gridrec``: none, ramlak, shepp, cosine, hamming, hann or parzen."""
    num_iter: Annotated[int, Field(ge=1)] | None = None
    """Of those that iterate; they need it."""
    num_block: Annotated[int, Field(ge=1)] | None = None
    """Of ordered subsets: how many."""
    ind_block: list[int] | None = None
    """Of ordered subsets: the order of the projections."""
    reg_par: float | list[float] | None = None
    """Of those that penalise: how much."""
    sinogram_order: bool = False
    """Changes nothing: projections are fed as tomopy needs them."""
    init_recon: None = None
    """Every reconstruction begins from scratch, or they could not be compared."""
    num_gridx: None = None
    """Slices are as wide as the detector."""
    num_gridy: None = None
    """Slices are as wide as the detector."""
    ncore: None = None
    """All cores work."""
    nchunk: None = None
    """Set by us."""

    def __post_init__(self) -> None:
        allowed = tomopy_adapter.recon_keywords(self.algorithm).intersection(OPTIONS)
        for name in self._given():
            if name not in allowed:
                found = f"tomopy takes no {name} for {self.algorithm}."
                raise PipelineError("recon", found, nearest(name, allowed))
        self._reconstruct()

    def run(self, work: Work) -> SideOutputs:
        """Leave the reconstructions, as `Reconstruct` does."""
        return self._reconstruct().run(work)

    def check_fits(self, scan: Scan) -> None:
        """Refuse an axis that the detector does not have."""
        self._reconstruct().check_fits(scan)

    def _given(self) -> dict[str, Any]:
        given = {name: getattr(self, name) for name in OPTIONS}
        return {name: value for name, value in given.items() if value is not None}

    def _reconstruct(self) -> Reconstruct:
        return Reconstruct(algorithm=self._chosen(), backend="tomopy", axis=self.center)

    def _chosen(self) -> Algorithm:
        """Return the algorithm under our names for it."""
        if self.algorithm in ("fbp", "gridrec"):
            filtered = Fbp if self.algorithm == "fbp" else Gridrec
            return filtered(window=window_of(self.filter_name or "shepp"))
        if self.num_iter is None:
            raise PipelineError("recon", f"{self.algorithm} iterates; num_iter is needed.")
        if self.algorithm == "sirt":
            return Sirt(iterations=self.num_iter, nonnegative=False)
        options = self._given()
        said = {"name": self.algorithm, "iterations": options.pop("num_iter"), "options": options}
        return checked(Iterative, said, "recon.algorithm")


def window_of(filter_name: str) -> Window:
    """Return our name for one of tomopy's filters."""
    if filter_name not in WINDOWS:
        found = f"no filter {filter_name!r}."
        raise PipelineError("recon.filter_name", found, nearest(filter_name, WINDOWS))
    return WINDOWS[filter_name]
