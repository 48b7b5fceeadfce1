"""Shifts of the projections in pictures and on the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from tomoslam_stage.comparison import Findings, Run, canvas
from tomoslam_stage.comparison.logbook import HEIGHT, draw_logbook
from tomoslam_stage.comparison.page.charts import shift_chart
from tomoslam_stage.comparison.page.viewers import sinogram_viewer
from tomoslam_stage.comparison.shifts import shifts_of
from tomoslam_stage.comparison.theta_picture import draw_panels, draw_shifts, height_of, panels_of


def labels(axes: Axes) -> list[str]:
    return [str(text) for text in axes.get_legend_handles_labels()[1]]


def test_true_shifts_are_told_with_the_axis_of_those_found(moved: Findings) -> None:
    shifts = shifts_of(moved)
    assert shifts is not None
    assert shifts.true is not None
    np.testing.assert_allclose(shifts.true, shifts.found, atol=1e-9)


def test_shifts_of_a_binned_scan_are_told_in_px_of_the_file(moved: Findings) -> None:
    binned = shifts_of(replace(moved, scan=replace(moved.scan, binning=2)))
    assert binned is not None
    np.testing.assert_allclose(binned.found, 2 * moved.refinement.shift)  # type: ignore[operator]
    np.testing.assert_allclose(binned.sigma, 0.06)


def test_shifts_stand_between_correction_and_residuals(moved: Findings, findings: Findings) -> None:
    for shown, count in ((moved, 2), (findings, 1)):
        panels = panels_of(shown, (2.0, 1.0))
        figure = canvas.new_figure(height_of(panels))
        draw_panels(figure, 0.0, shown, panels)
        assert len(figure.axes) == count
    assert shift_chart(findings) is None


@pytest.mark.parametrize(
    ("status", "said"),
    [("accepted", "shift, rms 0.44 px"), ("kept", "shift found, not used, rms 0.44 px")],
)
def test_the_curve_says_whether_the_shifts_are_used(
    moved: Findings, status: str, said: str
) -> None:
    shown = replace(moved, refinement=replace(moved.refinement, status=status))
    axes = canvas.panel(canvas.new_figure(2), canvas.Box(1, 0, 5, 1))
    draw_shifts(axes, np.arange(90.0), shown)
    assert labels(axes) == ["± 2 σ", "± 1 σ", said, "true shift"]


def test_without_sigma_there_is_no_band(moved: Findings) -> None:
    chart = shift_chart(
        replace(moved, refinement=replace(moved.refinement, shift_sigma=None), truth=None)
    )
    assert chart is not None
    assert [series["kind"] for series in chart["series"]] == ["line"]


def test_the_sinogram_from_refined_angles_stands_still(moved: Findings) -> None:
    still = replace(moved, refinement=replace(moved.refinement, shift=None))
    shown, unmoved = (sinogram_viewer(each) for each in (moved, still))
    assert shown is not None
    assert unmoved is not None
    for now, then in zip(shown["stacks"], unmoved["stacks"], strict=True):
        assert now["layers"]["refined"] != then["layers"]["refined"]


def test_a_logbook_with_shifts_has_room_for_every_number(
    tmp_path: Path, moved: Findings, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: dict[str, float] = {}

    def write(_: object, place: tuple[float, float], text: str, __: object) -> None:
        written[text] = place[1]

    monkeypatch.setattr(canvas, "write", write)
    # As long as reasons are.
    refinement = replace(moved.refinement, reason="as two halves say " * 12)
    draw_logbook(tmp_path / "logbook.png", replace(moved, refinement=refinement), run)
    assert written["contrast / 1/px"] < HEIGHT - 0.4
