"""The graph of all that is known about the angles, axis, roll and shifts.

A map, or features that were eliminated, tie every angle to every other: their information matrices
are full. So is the Hessian factor that they and the factors on single angles add up to, on one
variable, the change of everything. At 5000 projections such a matrix takes 200 MB: it is added up
in place, and its covariance found in place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tomoslam_stage.refinement.graph import normal_equations, solve_dense
from tomoslam_stage.symmetric import blocks, factorised, inverse, solved

if TYPE_CHECKING:
    from tomoslam_stage.products import Floats, Integers, Layout, Quadratic

AXIS_SIGMA_PX, ROLL_SIGMA_DEG = 0.5, 0.3
"""How far the axis may lie from where the recorded angles put it, and how far it may lean."""


@dataclass(frozen=True)
class Joint:
    """What everything heard so far says about a change of the geometry."""

    layout: Layout
    """Of changes."""
    information: Floats
    """(k, k), added to in place."""
    pull: Floats
    """(k,), added to in place."""

    @classmethod
    def of(cls, layout: Layout) -> Joint:
        """Begin with nothing."""
        return cls(layout, np.zeros((layout.size,) * 2), np.zeros(layout.size))

    def hear_graph(self, graph: Any) -> None:
        """Add the factors of a `gtsam.GaussianFactorGraph` on corrections of single angles."""
        information, pull = normal_equations(graph, self.layout.n)
        self.information[information.row, information.col] += information.data
        self.pull[self.layout.angles] += pull

    def hear_chain(self, covariance: Floats, wanted: Floats) -> None:
        """Add what steps whose errors hang together say.

        Parameters
        ----------
        covariance
            (2, n - 1) radians squared: of the steps, and of each with the next.
        wanted
            (n - 1,) radians: change of each step.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded

        n, root = self.layout.n, (cholesky_banded(covariance, lower=True), True)
        for columns in blocks(n):
            step, angle = np.arange(n - 1)[:, None], np.arange(n)[columns]
            differences = (angle == step + 1) - (angle == step).astype(np.float64)
            weighed = cho_solve_banded(root, differences, overwrite_b=True, check_finite=False)
            self.information[: n - 1, columns] -= weighed
            self.information[1:n, columns] += weighed
        weighed = cho_solve_banded(root, wanted)
        self.pull[: n - 1] -= weighed
        self.pull[1:n] += weighed

    def hold(self, back: Floats, shift_px: float) -> None:
        """Hold axis, roll and shifts loosely where a change `back` (k,) leads to.

        Shifts are those of a sample that jitters by `shift_px`, which holds what nobody sees of
        them: a common one is the axis, one round the turn a place of the whole sample.
        """
        sigma = np.full(self.layout.size, shift_px)
        sigma[self.layout.line] = AXIS_SIGMA_PX, np.deg2rad(ROLL_SIGMA_DEG)
        some = np.arange(self.layout.n, self.layout.size)
        self.information[some, some] += sigma[some] ** -2
        self.pull[some] += back[some] / sigma[some] ** 2

    def hear(self, quadratic: Quadratic) -> None:
        """Add what a source says, but for a turn of all angles together: nobody sees that."""
        angles, said = self.layout.angles, quadratic.information
        self.information[:] += said
        by_row = said[angles].mean(axis=0)
        by_column = said[:, angles].mean(axis=1)
        by_column[angles] -= by_row[angles].mean()
        self.information[angles] -= by_row
        self.information[:, angles] -= by_column[:, None]
        self.pull[:] += without_turn(quadratic.pull, self.layout)

    def solved(self) -> Solved:
        """Solve for what is wanted most; what was heard is used up.

        Raises
        ------
        LinAlgError
            If something is held by nothing, or is no number.
        """
        free = self.layout.free(slice(0, self.layout.size))
        information = self.information
        if len(free) < self.layout.size:
            information = information[np.ix_(free, free)]
        change = np.zeros(self.layout.size)
        change[free] = solve_dense(information, self.pull[free])
        return Solved(free, information, change)


@dataclass(frozen=True)
class Solved:
    """The answer to all that was heard."""

    free: Integers
    """(v,) numbers of those that are not held."""
    information: Floats
    """(v, v) used up by `root`."""
    change: Floats
    """(k,) that is wanted most; none of what is held."""

    @cached_property
    def root(self) -> Floats:
        """(v, v) of the information, see `symmetric.factorised`."""
        return factorised(self.information)

    def moved_by(self, pull: Floats) -> Floats:
        """(k,) the change that a further `pull` (k,) would make."""
        change = np.zeros(len(pull))
        change[self.free] = solved(self.root, pull[self.free])
        return change

    def covariance(self) -> Floats:
        """(v, v) of what is free; the last that can be asked, as `root` is used up."""
        return inverse(self.root)


def without_turn(entries: Floats, layout: Layout) -> Floats:
    """(k,) a change, or a pull, without what turns all angles together."""
    return np.append(entries[layout.angles] - entries[layout.angles].mean(), entries[layout.n :])
