"""reconstruct: Scan and Refinement -> Reconstructions."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from tomoslam_stage import scans
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.heldout import textured
from tomoslam_stage.methods import chosen_from, method, name_of
from tomoslam_stage.products import (
    Floats,
    Integers,
    Reconstruction,
    Reconstructions,
    Refinement,
    Scan,
    Truth,
)
from tomoslam_stage.reconstruction import ALGORITHMS, Algorithm, Fbp
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.stages.work import SideOutputs, Work, made


@method
class Reconstruct:
    """Reconstruct the same slices from the recorded and from the refined angles.

    Each set of angles has the axis that suits it best. The refined angles are turned as a whole
    until their mean change is zero: a common angle turns the slices and improves nothing.
    """

    needs: ClassVar = ("scan", "refinement")
    makes: ClassVar = ("reconstructions",)

    algorithm: Annotated[Algorithm, chosen_from(ALGORITHMS, "reconstruct.algorithm")] = field(
        default_factory=Fbp
    )
    """How slices are made."""
    rows: tuple[Annotated[int, Field(ge=0)], ...] | None = None
    """Detector rows of the file to reconstruct; by default three, spread over what is there."""

    def run(self, work: Work) -> SideOutputs:
        """Leave the reconstructions; of simulated scans one from the true angles, too."""
        scan, refinement = made(work.scan, "scan"), made(work.refinement, "refinement")
        truth = scans.read_truth(work.path)
        work.reconstructions = self.reconstruct(scan, refinement, truth)
        return {}

    def reconstruct(
        self, scan: Scan, refinement: Refinement, truth: Truth | None = None
    ) -> Reconstructions:
        """Slices by name: ``recorded``, ``refined`` and, where it is known, ``true``."""
        rows = self._rows(scan)
        sinograms = scan.sinograms(rows)

        def slices(theta: Floats, axis: float) -> Reconstruction:
            return Reconstruction(
                theta=theta,
                axis=axis,
                rows=rows,
                slices=self.algorithm.slices(sinograms, theta, axis),
                method=f"finufft {name_of(self.algorithm, ALGORITHMS)}",
            )

        recorded, axes = refinement.recorded, refinement.axes
        by_name = {
            "recorded": slices(recorded, axes["recorded"]),
            "refined": slices(turned_to(recorded, refinement.refined), axes["refined"]),
        }
        if truth is not None:
            theta = turned_to(recorded, truth.theta)
            axis = Reprojection().best_axis(sinograms, theta, axes["refined"], step=0.5)
            by_name["true"] = slices(theta, axis)
        return by_name

    def _rows(self, scan: Scan) -> Integers:
        if self.rows is None:
            there = np.flatnonzero(textured(scan))
            # "lower" gives a row that is there; a mean of two might lie where nothing is.
            middles = np.quantile(there, (0.25, 0.5, 0.75), method="lower")
            return np.unique(middles.astype(np.intp))
        rows = np.unique(np.array(self.rows, np.intp) // scan.binning)
        if len(rows) == 0 or rows[-1] >= scan.n_rows:
            raise PipelineError(
                "reconstruct.rows",
                f"{list(self.rows)}; rows between 0 and {scan.n_rows * scan.binning - 1} "
                f"are needed for {scan.name}.",
            )
        return rows


def turned_to(recorded: Floats, theta: Floats) -> Floats:
    """Turn `theta` (n,) as a whole until its mean difference from `recorded` is zero."""
    return np.asarray(theta - np.mean(theta - recorded))
