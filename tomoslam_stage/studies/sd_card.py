"""Figure 7 of the paper: slices from recorded and from refined angles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from tomoslam_stage.comparison.regions import (
    Window,
    disc,
    grey_limits,
    most_changed_first,
    most_changed_material,
)
from tomoslam_stage.methods import method
from tomoslam_stage.products import Comparison, Pixels, Reconstructions, Refinement
from tomoslam_stage.stages.work import made
from tomoslam_stage.studies import panels
from tomoslam_stage.studies.panels import ABOVE, BELOW, Words
from tomoslam_stage.studies.study import Claim, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tomoslam_stage.stages import Work
    from tomoslam_stage.studies.case import Case

PIPELINES = ("paper", "default")
FIGURES = {"psnr": "PSNR {:.1f} dB", "ssim": "SSIM {:.3f}"}
"""Key of `Comparison.similarity` -> how it is written above a slice."""


class Run(NamedTuple):
    """What a pipeline left behind."""

    refinement: Refinement
    reconstructions: Reconstructions
    comparison: Comparison

    @classmethod
    def of(cls, work: Work) -> Run:
        """Take it from where the stages left it."""
        return cls(
            made(work.refinement, "refinement"),
            made(work.reconstructions, "reconstructions"),
            made(work.comparison, "comparison"),
        )

    def figures(self, name: str) -> dict[str, float]:
        """Figures of the slices from the ``recorded`` or the ``refined`` angles."""
        compared = self.comparison
        told = {key: by_name[name] for key, by_name in compared.similarity.items()}
        if compared.errors:
            told["rms_deg"] = compared.errors[f"{name}_rms_deg"]
        resolution = compared.frc_resolution_px.get(name, float("nan"))
        width = compared.edge_width_px.get(name, float("nan"))
        return {**told, "frc_resolution_px": resolution, "edge_width_px": width}


@method
class SdCard:
    """Slices from recorded angles, from those of the published and of the default pipeline."""

    fast: ClassVar[Mapping[str, Any]] = {}

    def run(self, case: Case) -> Outcome:
        """Run both pipelines, and set their slices side by side."""
        runs = {pipeline: Run.of(case.refined(pipeline)) for pipeline in PIPELINES}
        default = runs["default"]
        figures = {"recorded": default.figures("recorded")}
        figures |= {pipeline: run.figures("refined") for pipeline, run in runs.items()}
        said = conclusion(figures, runs)
        return Outcome(
            conclusion=said,
            table=[{"angles": name, **row} for name, row in figures.items()],
            numbers={
                "figures": figures,
                "status": {name: run.refinement.status for name, run in runs.items()},
                "reason": {name: run.refinement.reason for name, run in runs.items()},
                "rows": default.reconstructions["recorded"].rows,
            },
            claims=claims(figures),
            figure=draw(figures, runs, [said, case.origin]),
        )


def conclusion(figures: Mapping[str, Mapping[str, float]], runs: Mapping[str, Run]) -> str:
    """Say how near the slices come to the true ones, and which angles stand."""
    verdicts = "; ".join(
        f"pipeline {name}: refined angles {run.refinement.status}"
        if run.refinement.status == "accepted"
        else f"pipeline {name}: recorded angles kept by the gate"
        for name, run in runs.items()
    )
    if "psnr" not in figures["recorded"]:
        text = "The true angles are not known, so that nothing says which slices are right; "
        told = [f"{name} {f['frc_resolution_px']:.3g} px" for name, f in figures.items()]
        return f"{text}resolution by ring correlation: {', '.join(told)}. {verdicts}."
    told = [
        f"{name} {f['psnr']:.1f} dB, {f['ssim']:.3f} (angles off by {f['rms_deg']:.3g} degrees)"
        for name, f in figures.items()
    ]
    return f"PSNR and SSIM against slices from the true angles: {'; '.join(told)}. {verdicts}."


def claims(figures: Mapping[str, Mapping[str, float]]) -> list[Claim]:
    """Set the figures beside the paper's, which shows pictures alone."""
    lines = {
        "rms_deg": ("angles, rms error / degrees", "{:.3g}"),
        "psnr": ("slices against true ones, PSNR / dB", "{:.1f}"),
        "ssim": ("slices against true ones, SSIM", "{:.3f}"),
    }
    recorded = figures["recorded"]
    return [
        Claim(
            f"{what} (recorded angles: {form.format(recorded[key])})",
            "-",
            *(form.format(figures[pipeline][key]) for pipeline in PIPELINES),
        )
        for key, (what, form) in lines.items()
        if key in recorded
    ]


def slices_of(runs: Mapping[str, Run]) -> dict[str, Pixels]:
    """(r, z, x) by name, in the order in which they are shown."""
    default = runs["default"].reconstructions
    slices = {"recorded": default["recorded"].slices}
    slices |= {name: run.reconstructions["refined"].slices for name, run in runs.items()}
    return slices | ({"true": default["true"].slices} if "true" in default else {})


def draw(
    figures: Mapping[str, Mapping[str, float]], runs: Mapping[str, Run], said: Sequence[str]
) -> Figure:
    """Draw the slice that changed most: whole above, the part that changed most below."""
    slices = slices_of(runs)
    recorded, best = slices["recorded"], slices["default"]
    index = most_changed_first(recorded, best)[0]
    inside = disc(recorded.shape[1:])
    shown = {name: np.where(inside, each[index], np.nan) for name, each in slices.items()}
    window = most_changed_material(recorded[index], best[index], inside)
    row = int(runs["default"].reconstructions["recorded"].rows[index])
    title = f"Slices of row {row} from recorded and refined angles (the paper's Figure 7)"
    side = panels.columns_of(len(shown), 0, 1)[0].width
    figure, top = panels.sheet(title, said, 2 * (side + ABOVE + BELOW))
    whole = Window(0, 0, max(inside.shape))
    for k, part in enumerate((whole, window)):
        parts = np.stack([part.cut(image) for image in shown.values()]).astype(np.float32)
        limits = grey_limits(parts, np.isfinite(parts[0]))
        boxes = panels.columns_of(len(shown), top + k * (side + ABOVE + BELOW), side)
        for box, name, seen in zip(boxes, shown, parts, strict=True):
            words = Words(*heading(name, figures, zoom=k > 0), "x / px", "z / px")
            draw_part(panels.named_panel(figure, box, words), part, seen, limits)
    return figure


def draw_part(axes: Axes, part: Window, seen: Pixels, limits: tuple[float, float]) -> None:
    """Draw `seen` (z, x), which was cut out of a slice at `part`."""
    height, width = seen.shape
    axes.imshow(
        np.ma.masked_invalid(seen),
        extent=(part.left - 0.5, part.left + width - 0.5, part.top + height - 0.5, part.top - 0.5),
        cmap="gray",
        vmin=limits[0],
        vmax=limits[1],
    )
    axes.grid(visible=False)
    axes.locator_params(nbins=4, integer=True)


def heading(name: str, figures: Mapping[str, Mapping[str, float]], zoom: bool) -> tuple[str, str]:
    """Return title and remark of a panel."""
    angles = f"pipeline {name}" if name in PIPELINES else f"{name} angles"
    if zoom:
        return angles, "what changed most"
    known = figures.get(name, {})
    return angles, ", ".join(form.format(known[k]) for k, form in FIGURES.items() if k in known)
