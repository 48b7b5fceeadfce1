"""reconstruct: Scan and Refinement -> Reconstructions."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tomoslam_stage import scans
from tomoslam_stage.comparison import HALVES
from tomoslam_stage.errors import PipelineError
from tomoslam_stage.geometry import around
from tomoslam_stage.heldout import textured
from tomoslam_stage.images import still
from tomoslam_stage.methods import chosen_from, method, name_of
from tomoslam_stage.products import (
    Floats,
    Integers,
    Pixels,
    Reconstruction,
    Reconstructions,
    Refinement,
    Scan,
    Truth,
)
from tomoslam_stage.reconstruction import (
    ALGORITHMS,
    Algorithm,
    BackendName,
    Fbp,
    Gridrec,
    choose_backend,
)
from tomoslam_stage.reprojection import Reprojection
from tomoslam_stage.stages.work import SideOutputs, Work, check_axis, made


@method
class Reconstruct:
    """Reconstruct the same slices from the recorded and from the refined angles.

    Each set of angles has the axis that suits it best, and the shifts of projections that were
    found with it. The refined angles are turned as a whole until their mean change is zero: a
    common angle turns the slices and improves nothing.
    """

    needs: ClassVar = ("scan", "refinement")
    makes: ClassVar = ("reconstructions",)

    algorithm: Annotated[Algorithm, chosen_from(ALGORITHMS, "reconstruct.algorithm")] = field(
        default_factory=Fbp
    )
    """How slices are made."""
    backend: BackendName = "auto"
    """What makes them; ``auto`` takes the first that is there and knows the algorithm."""
    halves: bool = True
    """Reconstruct every other projection alone, too, as the Fourier ring correlation needs it.

    Of what iterates, the middle row only: that takes a third longer, and not twice as long."""
    axis: float | None = None
    """Detector column of the rotation axis, px of the file; by default what suits each angles."""
    rows: tuple[Annotated[int, Field(ge=0)], ...] | None = None
    """Detector rows of the file to reconstruct; by default three, spread over what is there."""

    def run(self, work: Work) -> SideOutputs:
        """Leave the reconstructions; of simulated scans one from the true angles, too."""
        scan, refinement = work.line_integrals(), made(work.refinement, "refinement")
        truth = scans.read_truth(work.path, scan.frames)
        work.reconstructions = self.reconstruct(scan, refinement, truth)
        return {}

    def check_fits(self, scan: Scan) -> None:
        """Refuse rows that are not there, and an algorithm that nothing installed knows."""
        choose_backend(self.backend, self.algorithm)
        check_axis("reconstruct.axis", self.axis, scan)
        if self.rows is not None:
            self._named_rows(self.rows, scan)

    def alone(self, scan: Scan, axis: float, shift: Floats | None = None) -> Pixels:
        """Slices (r, z, x) from the angles of `scan` as they are, the axis at this column, px.

        Each projection is taken to lie by its own of `shift` (n,) px to the right.
        """
        self.check_fits(scan)
        rows = self._rows(scan)
        whole = Part(rows, scan.sinograms(rows), np.arange(scan.n_projections))
        return self._reconstructed(View(scan.theta, axis, shift), whole).slices

    def reconstruct(
        self, scan: Scan, refinement: Refinement, truth: Truth | None = None
    ) -> Reconstructions:
        """Slices by name: ``recorded``, ``refined`` and, where it is known, ``true``; halves too.

        Raises
        ------
        BackendMissingError
            If nothing that is installed can do it.
        PipelineError
            If a row is not there.
        """
        self.check_fits(scan)
        rows = self._rows(scan)
        whole = Part(rows, scan.sinograms(rows), np.arange(scan.n_projections))
        parts = {"": whole}
        if self.halves and scan.n_projections > 1:
            both = every_other(refinement.recorded)
            part = whole if isinstance(self.algorithm, Fbp | Gridrec) else whole.middle_row()
            parts |= {end: part.half(used) for end, used in zip(HALVES, both, strict=True)}
        if self.axis is not None:
            column = scan.column_from_file(self.axis)
            refinement = replace(refinement, axes=dict.fromkeys(refinement.axes, column))
        if truth is not None and truth.shift is not None:
            truth = replace(truth, shift=truth.shift / scan.binning)
        return {
            name + ending: self._reconstructed(view, part)
            for name, view in views(whole.sinograms, refinement, truth).items()
            for ending, part in parts.items()
        }

    def _reconstructed(self, view: View, part: Part) -> Reconstruction:
        backend = choose_backend(self.backend, self.algorithm)
        theta = view.theta[part.projections]
        shift = None if view.shift is None else view.shift[part.projections]
        sinograms = still(part.sinograms, shift)
        made = backend.reconstruct(self.algorithm, sinograms, theta, view.axis)
        return Reconstruction(
            theta=theta,
            axis=view.axis,
            rows=part.rows,
            slices=made.slices,
            method=f"{backend.name} {name_of(self.algorithm, ALGORITHMS)}",
            convergence=made.convergence,
        )

    def _rows(self, scan: Scan) -> Integers:
        if self.rows is not None:
            return self._named_rows(self.rows, scan)
        there = np.flatnonzero(textured(scan))
        # "lower" gives a row that is there; a mean of two might lie where nothing is.
        middles = np.quantile(there, (0.25, 0.5, 0.75), method="lower")
        return np.unique(middles.astype(np.intp))

    @staticmethod
    def _named_rows(named: tuple[int, ...], scan: Scan) -> Integers:
        rows = np.unique(np.array(named, np.intp) // scan.binning)
        if len(rows) == 0 or rows[-1] >= scan.n_rows:
            raise PipelineError(
                "reconstruct.rows",
                f"{list(named)}; rows between 0 and {scan.n_rows * scan.binning - 1} "
                f"are needed for {scan.name}.",
            )
        return rows


class Part(NamedTuple):
    """Some rows of some projections."""

    rows: Integers
    """(r,) detector rows."""
    sinograms: Pixels
    """(r, n, column) line integrals."""
    projections: Integers
    """(n,) which they are."""

    def middle_row(self) -> Part:
        """Return one row of all of these projections."""
        k = len(self.rows) // 2
        return self._replace(rows=self.rows[k : k + 1], sinograms=self.sinograms[k : k + 1])

    def half(self, used: Integers) -> Part:
        """Return all of these rows of the projections `used` (h,)."""
        return Part(self.rows, self.sinograms[:, used], used)


class View(NamedTuple):
    """Where the projections are taken to look from."""

    theta: Floats
    """(n,) radians."""
    axis: float
    """Detector column, px."""
    shift: Floats | None = None
    """(n,) px that each projection lies to the right, where some do."""


def views(sinograms: Pixels, refinement: Refinement, truth: Truth | None) -> dict[str, View]:
    """By name: each set of angles, turned over the recorded ones, with the axis that suits it.

    The shifts of `truth` are in px of `sinograms` (r, n, column).
    """
    recorded, axes = refinement.recorded, refinement.axes
    by_name = {
        "recorded": View(recorded, axes["recorded"]),
        "refined": View(turned_to(recorded, refinement.refined), axes["refined"], refinement.shift),
    }
    if truth is not None:
        theta = turned_to(recorded, truth.theta)
        aligned = still(sinograms, truth.shift)
        axis = Reprojection().best_axis(aligned, theta, axes["refined"], step=0.5)
        by_name["true"] = View(theta, axis, truth.shift)
    return by_name


def every_other(theta: Floats) -> tuple[Integers, Integers]:
    """Split projections in two halves that both go evenly round the turn, whatever their order.

    Each holds every other projection in the order of the angles within the turn: in an interlaced
    scan, neighbours in time are no neighbours in angle.
    """
    order = around(theta)
    return np.sort(order[::2]), np.sort(order[1::2])


def turned_to(recorded: Floats, theta: Floats) -> Floats:
    """Turn `theta` (n,) as a whole until its mean difference from `recorded` is zero."""
    return np.asarray(theta - np.mean(theta - recorded))
