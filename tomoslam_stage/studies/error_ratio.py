"""Figure 6 and equation 7 of the paper: what the factor graph gains, for which noise."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from tomoslam_stage.methods import method
from tomoslam_stage.progress import progress
from tomoslam_stage.studies.cv import OURS, PAPER, measured
from tomoslam_stage.studies.error_ratio_picture import Points, draw
from tomoslam_stage.studies.monte_carlo import (
    READINGS,
    Cell,
    Graphs,
    Grid,
    Ratios,
    SameAccuracy,
    Sigmas,
    crossing,
    rmse,
)
from tomoslam_stage.studies.published import NOISIER, RATIO, SIGMA_ENCODER, STEP
from tomoslam_stage.studies.study import Claim, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tomoslam_stage.studies.case import Case

WORSE = 0.99
"""Ratio below which a graph makes angles worse; what is nearer to 1 may be chance."""
Sigma = Annotated[float, Field(gt=0)]


@method
class ErrorRatio:
    """RMSE of the stepper over that of the graph, over CV sigma, encoder sigma and step size."""

    fast: ClassVar[Mapping[str, Any]] = {
        "draws": 20,
        "angles": 120,
        "steps_deg": (6.0, 9.0),
        "sigma_cv_deg": (0.05, 0.16, 0.5),
        "sigma_encoder_deg": (0.02, 0.05, 0.12),
    }

    steps_deg: Annotated[tuple[Annotated[float, Field(gt=0, lt=180)], ...], Field(min_length=1)] = (
        4.0, 5.0, 10.0,
    )  # fmt: skip
    """Steps of the CV factors, degrees; each graph has one."""
    sigma_cv_deg: Annotated[tuple[Sigma, ...], Field(min_length=2)] = (
        0.02, 0.03, 0.05, 0.08, 0.12, 0.16, 0.25, 0.4, 0.7, 1.4, 3.0,
    )  # fmt: skip
    """Standard deviations of the CV steps, degrees."""
    sigma_encoder_deg: Annotated[tuple[Sigma, ...], Field(min_length=2)] = (
        0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.4,
    )  # fmt: skip
    """Standard deviations of the stepper, degrees."""
    angles: Annotated[int, Field(ge=10)] = 360
    """Angles round the turn."""
    draws: Annotated[int, Field(ge=2)] = 500
    """Graphs for each cell."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the noise; all cells of a step share it, scaled."""

    def graphs(self, reading: str, step: float) -> Graphs:
        """Return the graphs of one step size."""
        return Graphs(self.angles, step, self.draws, self.seed, reading)

    def run(self, case: Case) -> Outcome:
        """Simulate all cells, and set beside them what the pipelines reach on the case."""
        grid, points = self.grid(), self.points(case)
        same = {step: self.same_accuracy(step) for step in self.steps_deg}
        said = conclusion(self, grid, same, points)
        return Outcome(
            conclusion=said,
            table=[row(cell, ratios) for cell, ratios in grid.items()],
            numbers={
                "seed": self.seed,
                "draws": self.draws,
                "angles": self.angles,
                "by_step_deg": same,
                "measured": points,
                "published": {
                    "ratio": RATIO,
                    "step_deg": STEP,
                    "sigma_encoder_deg": SIGMA_ENCODER,
                    "noisier_stepper": NOISIER,
                },
            },
            claims=claims(same, points),
            figure=draw(grid, same, points, [said, case.origin]),
        )

    def grid(self) -> Grid:
        """Simulate all cells."""
        sets = list(product(READINGS, self.steps_deg))
        grid = {}
        for reading, step in progress(sets, "solving graphs", len(sets)):
            graphs = self.graphs(reading, step)
            for cv, encoder in product(self.sigma_cv_deg, self.sigma_encoder_deg):
                sigmas = Sigmas(cv, encoder)
                grid[Cell(reading, step, sigmas)] = graphs.ratios(sigmas)
        return grid

    def same_accuracy(self, step: float) -> SameAccuracy:
        """Find the CV noise that gives the published ratio, and what noise a stepper may have."""
        graphs = self.graphs("walk", step)
        cv = crossing(lambda cv: graphs.ratios(Sigmas(cv, SIGMA_ENCODER)).of_means, RATIO)
        if np.isnan(cv):
            return SameAccuracy(cv, cv, cv, {})
        alone = float(graphs.rmse_of_stepper(SIGMA_ENCODER).mean())
        published = Sigmas(cv, SIGMA_ENCODER)

        def gain(encoder: float, believed: Sigmas | None = None) -> float:
            return alone / float(rmse(graphs.errors(Sigmas(cv, encoder), believed)).mean())

        return SameAccuracy(
            sigma_cv_deg=cv,
            informed=crossing(gain, 1) / SIGMA_ENCODER,
            fixed=crossing(lambda encoder: gain(encoder, published), 1) / SIGMA_ENCODER,
            curve={encoder: gain(encoder) for encoder in self.sigma_encoder_deg},
        )

    def points(self, case: Case) -> Points | None:
        """Return what was measured on the case; None where its true angles are not known."""
        if case.truth is None:
            return None
        step = self.steps_deg[-1]
        sigmas = {name: measured(case, name, step).sigma for name in (PAPER, OURS)}
        graphs, encoder = self.graphs("walk", step), case.step_sigma_deg
        return Points(
            step_deg=step,
            sigma_encoder_deg=encoder,
            sigma_cv_deg=sigmas,
            expected={
                name: graphs.ratios(Sigmas(sigma, encoder)).of_means
                for name, sigma in sigmas.items()
                if sigma > 0 and encoder > 0
            },
            ratios={p: case.errors_of(p)["error_ratio"] for p in ("paper", "default")},
        )


def row(cell: Cell, ratios: Ratios) -> dict[str, Any]:
    """Return a line of the table."""
    return {
        "reading": cell.reading,
        "step_deg": cell.step_deg,
        "sigma_cv_deg": cell.sigmas.cv,
        "sigma_encoder_deg": cell.sigmas.encoder,
        "ratio_of_means": ratios.of_means,
        "mean_of_ratios": ratios.mean,
        "rmse_stepper_deg": ratios.stepper,
        "rmse_graph_deg": ratios.graph,
    }


def conclusion(
    study: ErrorRatio, grid: Grid, same: Mapping[float, SameAccuracy], points: Points | None
) -> str:
    """Say what it takes to reach the published ratio, and what was reached."""
    step, cells = study.steps_deg[-1], len(grid) // len(READINGS)
    worse = {
        reading: sum(r.of_means < WORSE for cell, r in grid.items() if cell.reading == reading)
        for reading in READINGS
    }
    return (
        f"{study.draws} graphs a cell, seed {study.seed}. Errors that add up: "
        f"{reach_said(step, same[step])} The graph makes angles worse in {worse['walk']} of "
        f"{cells} cells; with independent errors, the words of the paper, in "
        f"{worse['independent']}. {measured_said(points)}"
    )


def reach_said(step: float, found: SameAccuracy) -> str:
    """Say what the published ratio needs."""
    published = f"the published ratio of {RATIO} with CV steps of {step:g} degrees and a stepper of"
    if np.isnan(found.sigma_cv_deg):
        return f"{published} {SIGMA_ENCODER} is out of reach, whatever the CV errors."
    return (
        f"{published} {SIGMA_ENCODER} needs CV errors of {found.sigma_cv_deg:.2g} degrees; such a "
        f"graph is as good as that stepper alone where its own is {found.informed:.2g} times "
        f"noisier ({found.fixed:.2g} where the graph does not know; published: {NOISIER})."
    )


def measured_said(points: Points | None) -> str:
    """Say what was measured on the case."""
    if points is None:
        return "The true angles of this scan are not known: nothing measured to set beside it."
    sigmas = ", ".join(
        f"{name} {sigma:.2g} degrees (ratio to expect {points.expected[name]:.2g})"
        if name in points.expected
        else f"{name} not measurable"
        for name, sigma in points.sigma_cv_deg.items()
    )
    ratios = ", ".join(f"{name} {ratio:.3g}" for name, ratio in points.ratios.items())
    return f"Measured on this scan: CV errors at {points.step_deg:g} degrees: {sigmas}; " + (
        f"ratio of the pipelines, one scan: {ratios}."
    )


def claims(same: Mapping[float, SameAccuracy], points: Points | None) -> list[Claim]:
    """Set the findings beside the published ones."""
    found = same.get(STEP)
    measured = {} if points is None else points.ratios
    ratios = [f"{measured[p]:.3g}" if p in measured else "-" for p in ("paper", "default")]
    needs = "-" if found is None else f"{RATIO} at CV errors of {found.sigma_cv_deg:.2g} degrees"
    noisier = "-" if found is None else f"{found.informed:.2g} ({found.fixed:.2g} if not known)"
    return [
        Claim("error ratio (eq. 7), measured on this scan", f"{RATIO}", *ratios),
        Claim("error ratio, Monte Carlo, 10 degrees, stepper 0.05", f"{RATIO}", needs, "-"),
        Claim("times noisier stepper, same accuracy", f"{NOISIER}", noisier, "-"),
    ]
