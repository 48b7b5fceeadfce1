"""Figure 4 of the paper: how well the CV estimator measures steps of several sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from tomoslam_stage.comparison import canvas
from tomoslam_stage.methods import method
from tomoslam_stage.studies import panels
from tomoslam_stage.studies.cv import OURS, PAPER, WAYS, Measured, measured
from tomoslam_stage.studies.panels import ABOVE, BELOW, Words
from tomoslam_stage.studies.published import BEST_STEPS, BIASED_STEP
from tomoslam_stage.studies.study import Claim, Outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomoslam_stage.studies.case import Case

USABLE_SIGMA, USABLE_SHARE = 2.0, 0.5
"""A step is usable whose errors are at most so many times those of the best step of its way, and
of which at least so many times as many triplets were measured."""
SIGNIFICANT = 3.0
"""Standard errors from which a median counts as biased."""
HEIGHT = 3.1
COLOURS = ("#d55e00", "#e69f00", "#56b4e9", "#0072b2", "#1a1a1a", "#bbbbbb")
"""Of `WAYS`, told apart by colour-blind readers."""

COUNTS: Mapping[Words, Callable[[Measured], float]] = {
    Words("triplets that were measured", "of those possible", "step / degrees", "share"): (
        lambda m: m.share
    ),
    Words("tracks in a triplet", "median", "step / degrees", "tracks"): (
        lambda m: m.typical_tracks
    ),
}
"""Words of each lower panel -> what it shows."""


@method
class StepSize:
    """Errors of measured steps: SURF and SIFT, the paper's minimal sample and all inliers."""

    fast: ClassVar[Mapping[str, Any]] = {"steps_deg": (3.0, 9.0, 21.0, 39.0)}

    steps_deg: Annotated[tuple[Annotated[float, Field(gt=0, lt=90)], ...], Field(min_length=1)] = (
        1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0, 30.0, 40.0,
    )  # fmt: skip
    """Steps inside the triplets, degrees."""

    def run(self, case: Case) -> Outcome:
        """Measure all triplets of all steps in all ways."""
        found = {name: [measured(case, name, step) for step in self.steps_deg] for name in WAYS}
        said = conclusion(found)
        return Outcome(
            conclusion=said,
            table=[m.row(name) for name, several in found.items() for m in several],
            numbers={
                "steps_deg": self.steps_deg,
                "reference": case.reference_name,
                "axis_px": case.axis,
                "usable_deg": {name: usable(several) for name, several in found.items()},
                "smallest_errors_deg": {name: finest(several) for name, several in found.items()},
            },
            claims=claims(found),
            figure=draw(case, found, said),
        )


def usable(several: Sequence[Measured]) -> list[float]:
    """Return the steps, degrees, that are about as good as the best, see `USABLE_SIGMA`."""
    known = [m for m in several if len(m.steps)]
    if not known:
        return []
    best = min(known, key=lambda m: m.sigma)
    return [
        m.step_deg
        for m in known
        if m.sigma <= USABLE_SIGMA * best.sigma and m.share >= USABLE_SHARE * best.share
    ]


def finest(several: Sequence[Measured]) -> list[float]:
    """Return the four steps, degrees, with the smallest errors; fewer where fewer were measured."""
    known = sorted((m for m in several if len(m.steps)), key=lambda m: m.sigma)
    return sorted(m.step_deg for m in known[: len(BEST_STEPS)])


def biased(several: Sequence[Measured]) -> list[float]:
    """Return the steps, degrees, whose median error is not zero."""
    return [
        m.step_deg
        for m in several
        if len(m.steps) and abs(m.quartiles[1]) > SIGNIFICANT * m.median_error
    ]


def conclusion(found: Mapping[str, Sequence[Measured]]) -> str:
    """Say which of the paper's findings hold here, and why the others do not."""
    paper, ours = found[PAPER], found[OURS]
    if not any(len(m.steps) for m in paper):
        return f"No triplet could be measured by {PAPER}: too few of its tracks agree."
    good = usable(paper)
    agrees = (
        "as published" if set(good) == set(BEST_STEPS) else f"published {panels.listed(BEST_STEPS)}"
    )
    text = f"{PAPER} (the paper's way): usable steps {panels.listed(good)} degrees ({agrees}). "
    text += f"{bias_said(paper)} {why(paper)} "
    return f"{text}{OURS}: usable {panels.listed(usable(ours))} degrees{best_said(ours)}."


def best_said(several: Sequence[Measured]) -> str:
    """Name the best step, where one was measured."""
    known = [m for m in several if len(m.steps)]
    if not known:
        return ""
    best = min(known, key=lambda m: m.sigma)
    return f", best {best.step_deg:g} with {best.sigma:.2g} degrees"


def bias_said(paper: Sequence[Measured]) -> str:
    """Say whether 7 degrees are biased more than their neighbours."""
    off = biased(paper)
    medians = {m.step_deg: abs(m.quartiles[1]) for m in paper if len(m.steps)}
    others = [medians[step] for step in BEST_STEPS if step != BIASED_STEP and step in medians]
    if BIASED_STEP not in medians or not others:
        return f"Biased: {panels.listed(off)} degrees."
    if BIASED_STEP in off and medians[BIASED_STEP] > max(others):
        return "That 7 degrees are biased more than 4, 5 and 10 holds."
    text = (
        f"That 7 degrees are biased more than 4, 5 and 10 does not hold ({medians[BIASED_STEP]:.2g}"
    )
    return f"{text} degrees against up to {max(others):.2g}); biased are {panels.listed(off)}."


def why(paper: Sequence[Measured]) -> str:
    """Say why small and large steps are worse, from how errors and tracks change."""
    known = [m for m in paper if len(m.steps)]
    best = min(known, key=lambda m: m.sigma)
    first, last = known[0], known[-1]
    told = []
    if first is not best:
        amplified = np.sin(np.deg2rad(best.step_deg)) / np.sin(np.deg2rad(first.step_deg))
        told.append(
            f"From {best.step_deg:g} to {first.step_deg:g} degrees errors grow "
            f"{first.sigma / best.sigma:.2g} times (geometry alone, 1 / sin of the step: "
            f"{amplified:.2g} times), tracks from {best.typical_tracks:.0f} to "
            f"{first.typical_tracks:.0f}: leverage is missing there, not tracks."
            if first.typical_tracks >= best.typical_tracks
            else f"At {first.step_deg:g} degrees tracks are missing."
        )
    if last is not best:
        told.append(
            f"At {last.step_deg:g} degrees {last.typical_tracks:.0f} tracks are left in a "
            f"triplet, and {100 * last.share:.0f} % of the triplets are measured."
        )
    return " ".join(told)


def claims(found: Mapping[str, Sequence[Measured]]) -> list[Claim]:
    """Set the findings beside the published ones."""
    paper, ours = found[PAPER], found[OURS]

    def at_ten(several: Sequence[Measured]) -> str:
        return next((f"{m.sigma:.2g}" for m in several if m.step_deg == 10 and len(m.steps)), "-")

    return [
        Claim(
            "usable CV steps / degrees",
            "4, 5, 7 and 10 (7 biased)",
            panels.listed(usable(paper)),
            panels.listed(usable(ours)),
        ),
        Claim("CV error at 10 degrees, sigma / degrees", "-", at_ten(paper), at_ten(ours)),
    ]


def draw(case: Case, found: Mapping[str, Sequence[Measured]], said: str) -> Figure:
    """Draw medians and quartiles over the step size, and below how much was measured."""
    title = "Step size: errors of the CV estimator (the paper's Figure 4)"
    figure, top = panels.sheet(title, [said, case.origin], 2 * (HEIGHT + ABOVE + BELOW) + 0.35)
    what = f"measured − {case.reference_name} step / degrees"
    remark = (
        "points: median; bars: first to third quartile; linear up to 1 degree, logarithmic beyond"
    )
    upper = panels.columns_of(1, top, HEIGHT + 0.5)[0]
    axes = panels.named_panel(
        figure, upper, Words("error of a step", remark, "step / degrees", what)
    )
    draw_quartiles(axes, found)
    below = panels.columns_of(2, top + HEIGHT + ABOVE + BELOW + 0.5, HEIGHT - 0.5)
    for box, (words, figure_of) in zip(below, COUNTS.items(), strict=True):
        draw_counts(panels.named_panel(figure, box, words), found, figure_of)
    return figure


def draw_counts(
    axes: Axes, found: Mapping[str, Sequence[Measured]], figure_of: Callable[[Measured], float]
) -> None:
    """Draw one figure of all ways over the step size."""
    for several, colour in zip(found.values(), COLOURS, strict=True):
        steps = [m.step_deg for m in several]
        axes.plot(steps, [figure_of(m) for m in several], ".-", color=colour, linewidth=1)
    step_axis(axes, [m.step_deg for m in next(iter(found.values()))])
    axes.set_ylim(bottom=0)


def draw_quartiles(axes: Axes, found: Mapping[str, Sequence[Measured]]) -> None:
    """Draw all ways beside each other, over the logarithm of the step."""
    axes.axhline(0, color=canvas.INK, linewidth=0.8)
    for k, (name, several) in enumerate(found.items()):
        aside = 1.025 ** (k - (len(found) - 1) / 2)
        known = [m for m in several if len(m.steps)]
        first, median, third = np.array([m.quartiles for m in known]).reshape(-1, 3).T
        steps = np.array([m.step_deg for m in known]) * aside
        bars = np.stack([median - first, third - median])
        style: dict[str, Any] = {"color": COLOURS[k], "linewidth": 1.4, "markersize": 4}
        axes.errorbar(steps, median, yerr=bars, fmt="o", capsize=2, label=name, **style)
    axes.set_yscale("symlog", linthresh=1)
    panels.plain_ticks(axes, "y", (-30, -10, -3, -1, -0.5, 0, 0.5, 1, 3, 10, 30, 100))
    axes.set_ylim(-60, 1000)  # the legend stands above all bars
    step_axis(axes, [m.step_deg for m in next(iter(found.values()))])
    panels.legend(axes, loc="upper right", ncols=2)


def step_axis(axes: Axes, steps: Sequence[float]) -> None:
    """Make the x axis logarithmic, with all steps named."""
    axes.set_xscale("log")
    panels.plain_ticks(axes, "x", steps)
