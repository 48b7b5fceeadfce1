"""Figure 5 of the paper: how the errors of measured steps are distributed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from tomoslam_stage.comparison.histograms import (
    HISTOGRAMS_HEIGHT,
    Histogram,
    counted,
    draw_histograms,
    normal_share,
)
from tomoslam_stage.methods import method
from tomoslam_stage.studies.cv import NORMAL_QUARTILES, OURS, PAPER, Measured, measured
from tomoslam_stage.studies.panels import sheet
from tomoslam_stage.studies.study import Claim, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from tomoslam_stage.products import Floats
    from tomoslam_stage.studies.case import Case

CHOSEN = (PAPER, OURS)
STEPS = ("first step", "second step")
LEVEL = 0.05
"""Probability below which a normal distribution is rejected."""
FEWEST = 20
"""Below so many values the test says nothing."""
REACH, BARS = 5.0, 41
"""The bars reach so many robust standard deviations to either side of the median."""


@dataclass(frozen=True)
class Shape:
    """How some values are distributed, degrees."""

    mean: float
    sigma: float
    """Standard deviation."""
    median: float
    sigma_from_quartiles: float
    """Of the normal distribution with these quartiles, which is the one that is drawn."""
    skewness: float
    excess_kurtosis: float
    outside: float
    """Share of the values more than three of these sigmas from the median; normal: 0.0027."""
    probability: float
    """That normally distributed values have such a skewness and kurtosis (D'Agostino and Pearson,
    Biometrika 60 (1973) 613). Triplets overlap and share errors, so that it is rather too small."""

    @property
    def verdict(self) -> str:
        """Say whether the values look normally distributed."""
        if np.isnan(self.probability):
            return "too few to tell"
        return "not normal" if self.probability < LEVEL else "normal"


def shape_of(values: Floats) -> Shape:
    """Describe `values` (m,)."""
    from scipy.stats import kurtosis, normaltest, skew

    if len(values) < FEWEST:
        return Shape(*(float("nan"),) * 8)
    first, median, third = (float(q) for q in np.percentile(values, [25, 50, 75]))
    sigma = (third - first) / NORMAL_QUARTILES
    return Shape(
        mean=float(values.mean()),
        sigma=float(values.std(ddof=1)),
        median=median,
        sigma_from_quartiles=sigma,
        skewness=float(skew(values)),
        excess_kurtosis=float(kurtosis(values)),
        outside=float(np.mean(np.abs(values - median) > 3 * sigma)),
        probability=float(normaltest(values).pvalue),
    )


@method
class Histograms:
    """Histograms of both steps of the triplets of one size, with a test of the noise model."""

    fast: ClassVar[Mapping[str, Any]] = {"step_deg": 9.0}

    step_deg: Annotated[float, Field(gt=0, lt=90)] = 10.0
    """Steps inside the triplets, degrees."""

    def run(self, case: Case) -> Outcome:
        """Measure the triplets, and describe how their steps are distributed."""
        found = {name: measured(case, name, self.step_deg) for name in CHOSEN}
        rows = [row for name, m in found.items() for row in shapes(case, name, m)]
        errors = {name: shape_of(m.errors.ravel()) for name, m in found.items()}
        said = " ".join(sentence(case, name, found[name], errors[name]) for name in CHOSEN)
        return Outcome(
            conclusion=said,
            table=rows,
            numbers={
                "step_deg": self.step_deg,
                "reference": case.reference_name,
                "errors": errors,
                "correlation_of_both_errors": {n: together(m) for n, m in found.items()},
            },
            claims=[
                Claim(
                    f"CV errors at {self.step_deg:g} degrees normally distributed",
                    "yes (by eye)",
                    *(f"{e.verdict} (p = {e.probability:.2g})" for e in errors.values()),
                )
            ],
            figure=draw(case, self.step_deg, found, said),
        )


def shapes(case: Case, name: str, found: Measured) -> list[dict[str, Any]]:
    """Rows of the table: both steps as measured, and their errors."""
    kinds = {"measured": found.steps, f"measured - {case.reference_name}": found.errors}
    return [
        {"way": name, "step": step, "values": kind, "count": len(values), **asdict(shape)}
        for kind, values in kinds.items()
        for k, step in enumerate(STEPS)
        for shape in [shape_of(values[:, k])]
    ]


def together(found: Measured) -> float:
    """Rank correlation of the errors of both steps of a triplet; the paper takes it for zero."""
    from scipy.stats import spearmanr

    if len(found.errors) < FEWEST:
        return float("nan")
    return float(spearmanr(found.errors).statistic)


def sentence(case: Case, name: str, found: Measured, errors: Shape) -> str:
    """Say what the histograms of one way show."""
    if np.isnan(errors.probability):
        return f"{name}: {len(found.steps)} triplets measured, too few to tell."
    return (
        f"{name}: errors against the {case.reference_name} steps are {errors.verdict} "
        f"(p = {errors.probability:.2g}), {100 * errors.outside:.1f} % beyond three sigma of "
        f"{errors.sigma_from_quartiles:.2g} degrees (normal: 0.3 %); those of both steps of a "
        f"triplet correlate by {together(found):+.2f}."
    )


def draw(case: Case, step: float, found: Mapping[str, Measured], said: str) -> Figure:
    """Draw both histograms of each way."""
    title = f"Histograms of both steps of triplets at {step:g} degrees (the paper's Figure 5)"
    figure, top = sheet(title, [said, case.origin], len(found) * HISTOGRAMS_HEIGHT)
    for k, (name, m) in enumerate(found.items()):
        panels = [histogram(f"{name}: {STEPS[j]}", m.steps[:, j]) for j in range(len(STEPS))]
        draw_histograms(figure, top + k * HISTOGRAMS_HEIGHT, panels)
    return figure


def histogram(title: str, values: Floats) -> Histogram:
    """Count the values in bars, beside the normal distribution that has their quartiles."""
    shape = shape_of(values)
    labels = ("measured step / degrees", "triplets")
    if np.isnan(shape.probability):
        return Histogram(title, f"{len(values)} triplets", labels, np.array([0, 1]), np.zeros(1))
    scale = shape.sigma_from_quartiles
    edges = shape.median + REACH * scale * np.linspace(-1, 1, BARS + 1)
    counts = counted(values, edges)
    remark = f"{len(values)} triplets; sigma {scale:.2g} (quartiles), {shape.sigma:.2g} (squares)"
    remark += f"; p = {shape.probability:.1g}"
    normal = len(values) * normal_share(edges - shape.median, scale)
    return Histogram(title, remark, labels, edges, counts, normal)
