"""Section 5.2 of the paper: how long the factor graph takes, and every station beside it."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tomoslam_stage.comparison import canvas
from tomoslam_stage.methods import method
from tomoslam_stage.products import AngleMeasurements, Floats
from tomoslam_stage.progress import progress
from tomoslam_stage.refinement.factors import FACTORS
from tomoslam_stage.refinement.graph import linear_graph, solve_once
from tomoslam_stage.studies import panels
from tomoslam_stage.studies.panels import ABOVE, BELOW, Words
from tomoslam_stage.studies.published import ANGLES, SECONDS
from tomoslam_stage.studies.study import Claim, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomoslam_stage.studies.case import Case

HEIGHT = 2.8
NOISE_DEG = 0.1
"""Of the CV steps; how long it takes does not depend on it."""
SEED = 0
PIPELINES = ("paper", "default")


class Took(NamedTuple):
    """Seconds."""

    build: float
    solve: float

    @property
    def together(self) -> float:
        """Seconds to build and to solve."""
        return self.build + self.solve


@method
class Timing:
    """Seconds to build and to solve the linear graph, and of every station of the pipelines."""

    fast: ClassVar[Mapping[str, Any]] = {"angles": (90, 360), "runs": 2}

    angles: Annotated[tuple[Annotated[int, Field(ge=40)], ...], Field(min_length=1)] = (
        360, 1800, 10000,
    )  # fmt: skip
    """Numbers of angles round the turn."""
    steps_deg: Annotated[tuple[Annotated[float, Field(gt=0, lt=90)], ...], Field(min_length=1)] = (
        4.0, 5.0, 10.0,
    )  # fmt: skip
    """Steps of the CV factors, degrees: triplets of all angles."""
    runs: Annotated[int, Field(ge=1)] = 11
    """The fastest of so many runs counts: the others waited for what else the machine was doing."""

    def run(self, case: Case) -> Outcome:
        """Time the graphs, and read what the stations of the pipelines took."""
        graphs = {n: self.graph(n) for n in progress(self.angles, "timing", len(self.angles))}
        stations = {pipeline: dict(case.refined(pipeline).seconds) for pipeline in PIPELINES}
        said = (
            f"CV factors at {panels.listed(self.steps_deg)} degrees. {conclusion(graphs, stations)}"
        )
        return Outcome(
            conclusion=said,
            table=[
                *({"what": f"graph, {n} angles", **each(took)} for n, took in graphs.items()),
                *(
                    {"what": f"{pipeline}: {name}", "build_s": "", "solve_s": "", "seconds": s}
                    for pipeline, seconds in stations.items()
                    for name, s in seconds.items()
                ),
            ],
            numbers={
                "seed": SEED,
                "graphs": {str(n): took._asdict() for n, took in graphs.items()},
                "stations_s": stations,
                "published_s": SECONDS,
            },
            claims=claims(graphs, stations),
            figure=draw(graphs, stations, [said, case.origin]),
        )

    def graph(self, count: int) -> Took:
        """Time the graph of `count` angles with prior, encoder and CV factors."""
        theta = np.linspace(0, 2 * np.pi, count, endpoint=False)
        found = triplets(theta, [round(step * count / 360) for step in self.steps_deg])
        blocks = {name: factor().block(theta, found) for name, factor in FACTORS.items()}
        weights = {name: np.ones(len(block.measured)) for name, block in blocks.items()}
        builds, solves = [], []
        for _ in range(self.runs):
            begin = perf_counter()
            graph = linear_graph(blocks, weights, theta)
            built = perf_counter()
            solve_once(graph, count)
            builds.append(built - begin)
            solves.append(perf_counter() - built)
        return Took(min(builds), min(solves))


def triplets(theta: Floats, steps: Sequence[int]) -> AngleMeasurements:
    """Make noisy measurements of the triplets of all angles, around the full turn."""
    here, sigma = np.arange(len(theta)), np.deg2rad(NOISE_DEG)
    projections = np.concatenate(
        [np.stack([here, here + step, here + 2 * step], axis=1) % len(theta) for step in steps]
    )
    noise = np.random.default_rng(SEED).normal(0, sigma, (len(projections), 2))
    covariance = np.tile(sigma**2 * np.eye(2), (len(projections), 1, 1))
    none = np.zeros(len(projections), np.intp)
    measured = np.diff(theta[projections], axis=1) + noise
    return AngleMeasurements(projections, measured, covariance, none, none)


def each(took: Took) -> dict[str, float]:
    """Return the columns of the table."""
    return {"build_s": took.build, "solve_s": took.solve, "seconds": took.together}


def conclusion(graphs: Mapping[int, Took], stations: Mapping[str, Mapping[str, float]]) -> str:
    """Say how the graph compares with the published time, and what takes longest."""
    times = ", ".join(f"{n} angles {took.together:.2g} s" for n, took in graphs.items())
    text = f"The linear graph, built and solved: {times}. "
    if ANGLES in graphs:
        factor = SECONDS / graphs[ANGLES].together
        faster = f"{factor:.2g} times faster" if factor > 1 else f"{1 / factor:.2g} times slower"
        text += f"Published: {SECONDS} s for {ANGLES} angles on twelve cores; {faster} here. "
    wholes = [
        f"{pipeline} {sum(seconds.values()):.0f} s, longest {max(seconds, key=seconds.__getitem__)}"
        for pipeline, seconds in stations.items()
    ]
    return f"{text}Pipelines on this scan: {'; '.join(wholes)}."


def claims(graphs: Mapping[int, Took], stations: Mapping[str, Mapping[str, float]]) -> list[Claim]:
    """Set the times beside the published one."""
    took = f"{graphs[ANGLES].together:.2g}" if ANGLES in graphs else "-"
    largest = max(graphs)
    wholes = [f"{sum(stations[pipeline].values()):.0f}" for pipeline in PIPELINES]
    return [
        Claim(f"graph of {ANGLES} angles, built and solved / s", f"{SECONDS}", took, took),
        Claim(f"graph of {largest} angles / s", "-", *[f"{graphs[largest].together:.2g}"] * 2),
        Claim("whole pipeline on this scan / s", "-", *wholes),
    ]


def draw(
    graphs: Mapping[int, Took], stations: Mapping[str, Mapping[str, float]], said: Sequence[str]
) -> Figure:
    """Draw seconds over the number of angles, and bars of all stations."""
    title = "Timing: the factor graph, and every station of the pipelines"
    figure, top = panels.sheet(title, said, HEIGHT + ABOVE + BELOW)
    left, *others = panels.columns_of(1 + len(stations), top, HEIGHT)
    words = Words("linear factor graph", "fastest of several runs", "angles", "seconds")
    draw_graphs(panels.named_panel(figure, left, words), graphs)
    for box, (pipeline, seconds) in zip(others, stations.items(), strict=True):
        whole = f"{sum(seconds.values()):.0f} s in all"
        words = Words(f"pipeline {pipeline}", whole, "seconds", "")
        axes = panels.named_panel(
            figure, box._replace(left=box.left + 0.2, width=box.width - 0.2), words
        )
        bars = axes.barh(list(seconds), list(seconds.values()), color=canvas.REFINED, height=0.6)
        axes.bar_label(bars, fmt=" %.1f", fontsize=canvas.SMALL_SIZE)
        axes.invert_yaxis()
        axes.margins(x=0.18)
    return figure


def draw_graphs(axes: Axes, graphs: Mapping[int, Took]) -> None:
    """Draw seconds over the number of angles."""
    numbers = list(graphs)
    colours = (canvas.RECORDED, canvas.MARK, canvas.REFINED)
    for name, colour in zip(("build", "solve", "together"), colours, strict=True):
        seconds = [getattr(took, name) for took in graphs.values()]
        axes.plot(numbers, seconds, ".-", color=colour, label=name)
    axes.plot([ANGLES], [SECONDS], "*", color=canvas.TRUE, markersize=9, label="published")
    axes.set(xscale="log", yscale="log")
    panels.plain_ticks(axes, "x", numbers)
    panels.plain_ticks(axes, "y", (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1))
    panels.legend(axes, loc="upper left")
