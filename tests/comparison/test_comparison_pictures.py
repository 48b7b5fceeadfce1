from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tomoslam_stage.comparison import Findings, canvas, draw_comparison, draw_theta
from tomoslam_stage.comparison import slices_picture as pictures
from tomoslam_stage.comparison.graphs import GRAPHS_HEIGHT, graphs_of
from tomoslam_stage.comparison.slice_pairs import slice_pairs
from tomoslam_stage.comparison.theta_picture import abscissa
from tomoslam_stage.products import Floats

DETAIL = (30, 52)


def pixels(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def assert_nothing_is_cut_off(path: Path) -> None:
    drawn = pixels(path)
    frame = np.ones(drawn.shape[:2], bool)
    frame[3:-3, 3:-3] = False
    assert drawn.shape[1] == 1600
    assert (drawn[frame] == 255).all()
    assert (drawn != 255).any()


def test_comparison_is_1600_px_wide_and_nothing_is_cut_off(
    tmp_path: Path, findings: Findings
) -> None:
    draw_comparison(tmp_path / "c.png", findings)
    assert_nothing_is_cut_off(tmp_path / "c.png")
    assert 1500 < pixels(tmp_path / "c.png").shape[0] < 2000


def test_the_row_that_changed_most_is_drawn_by_default(findings: Findings) -> None:
    (pair,) = slice_pairs(findings, None)
    assert pair.label == "detector row 7"
    top, left, side = pair.window
    assert top <= DETAIL[0] < top + side
    assert left <= DETAIL[1] < left + side


def test_chosen_rows_are_drawn_below_each_other(tmp_path: Path, findings: Findings) -> None:
    draw_comparison(tmp_path / "one.png", findings, rows=[7])
    draw_comparison(tmp_path / "two.png", findings, rows=[7, 2])
    one, two = (pixels(tmp_path / f"{n}.png").shape[0] for n in ("one", "two"))
    assert two - one == pytest.approx(pictures.BLOCK * canvas.DPI, abs=1)


def test_of_many_rows_three_are_drawn_the_most_changed_among_them(findings: Findings) -> None:
    both = {
        name: replace(made, rows=np.arange(5), slices=made.slices[[0, 0, 0, 0, 1]])
        for name, made in findings.reconstructions.items()
    }
    pairs = slice_pairs(replace(findings, reconstructions=both), range(5))
    assert [pair.row for pair in pairs] == [4, 0, 1]


def test_a_row_without_a_slice_is_refused(tmp_path: Path, findings: Findings) -> None:
    with pytest.raises(ValueError, match=r"rows \[3\]; there are slices of \[2, 7, 11\]"):
        draw_comparison(tmp_path / "c.png", findings, rows=[3])
    assert list(tmp_path.iterdir()) == []


def test_a_missing_reconstruction_is_refused(tmp_path: Path, findings: Findings) -> None:
    alone = {"recorded": findings.reconstructions["recorded"]}
    with pytest.raises(ValueError, match="no refined reconstruction"):
        draw_comparison(tmp_path / "c.png", replace(findings, reconstructions=alone))


def test_recorded_refined_and_true_share_one_grey_scale_that_truth_does_not_move(
    findings: Findings,
) -> None:
    made = findings.reconstructions
    bright = replace(made["refined"], slices=made["refined"].slices * 50)
    (without,) = slice_pairs(findings, None)
    informed = replace(findings, reconstructions={**made, "true": bright})
    (pair,) = slice_pairs(informed, None)
    scales = [pictures.scale(pair, name) for name in ("recorded", "refined", "true")]
    assert scales == [pictures.scale(without, "recorded")] * 3
    assert pair.window == without.window


@pytest.mark.parametrize("name", ["recorded", "refined"])
def test_the_grey_scale_reaches_the_brightest_of_both_slices(findings: Findings, name: str) -> None:
    made = findings.reconstructions
    bright = replace(made[name], slices=made[name].slices * 3)
    (pair,) = slice_pairs(replace(findings, reconstructions={**made, name: bright}), [7])
    assert pair.limits == pytest.approx((0, 0.09))


def test_the_scale_of_the_difference_is_symmetric(findings: Findings) -> None:
    (pair,) = slice_pairs(findings, None)
    scale = pictures.scale(pair, "difference")
    assert scale["vmin"] == -scale["vmax"]
    assert scale["vmax"] == pytest.approx(0.02)


def test_equal_values_are_drawn_in_the_same_grey_however_bright_a_new_detail_is(
    tmp_path: Path, findings: Findings
) -> None:
    made = findings.reconstructions
    slices = made["refined"].slices
    bright = replace(made["refined"], slices=np.where(slices > 0.015, 5 * slices, slices))
    changed = replace(findings, reconstructions={**made, "refined": bright})
    draw_comparison(tmp_path / "c.png", changed, rows=[7])
    page = pixels(tmp_path / "c.png")
    top = page.shape[0] - round((GRAPHS_HEIGHT + pictures.BLOCK - 0.5) * canvas.DPI)
    # Of both slices the part below the middle, where nothing but the even body is.
    row = top + round(0.7 * pictures.IMAGE * canvas.DPI)
    recorded, refined = (
        page[row, round((left + pictures.IMAGE / 2) * canvas.DPI)] for left in pictures.COLUMNS[:2]
    )
    assert np.array_equal(recorded, refined)
    assert 0 < recorded[0] < 100


def test_all_that_there_can_be_is_drawn_whole(tmp_path: Path, complete: Findings) -> None:
    draw_comparison(tmp_path / "c.png", complete)
    assert_nothing_is_cut_off(tmp_path / "c.png")


def test_panels_of_curves_appear_with_what_they_show(
    findings: Findings, complete: Findings, tiny: Callable[[int], Findings]
) -> None:
    def shown(which: Findings) -> list[list[str]]:
        graphs = graphs_of(which, slice_pairs(which, None)[0])
        return [[curve.name for curve in graph.curves] for graph in graphs]

    names = ["recorded", "refined", "true"]
    assert shown(complete) == [names, [*names, "threshold"], names]
    assert shown(findings) == [names[:2]]
    assert shown(tiny(3)) == []


def test_the_legends_tell_the_numbers_of_the_report(complete: Findings) -> None:
    edge, ring, convergence = graphs_of(complete, slice_pairs(complete, None)[0])
    numbers = complete.comparison
    for graph, widths in ((edge, numbers.edge_width_px), (ring, numbers.frc_resolution_px)):
        for curve in graph.curves[:3]:
            assert curve.label == f"{curve.name}: {widths[curve.name]:.3g} px"
    assert convergence.curves[0].label == "recorded: 0.00667 in the end"


def test_the_line_across_the_edge_does_not_widen_the_zoom(findings: Findings) -> None:
    (pair,) = slice_pairs(findings, None)
    figure = canvas.new_figure(4)
    box = canvas.Box(1, 1, 2, 2)
    image = pictures.draw_part(figure, box, pair, ("recorded", pair.window))
    before = image.axes.get_xlim(), image.axes.get_ylim()
    pictures.mark_edge(image.axes, pair)
    figure.draw_without_rendering()
    assert len(image.axes.lines) == 1
    assert (image.axes.get_xlim(), image.axes.get_ylim()) == before


def test_a_binned_row_is_named_by_the_rows_of_the_file(findings: Findings) -> None:
    binned = replace(findings, scan=replace(findings.scan, binning=4))
    (pair,) = slice_pairs(binned, None)
    assert pair.label == "detector rows 28 to 31"


def test_pictures_do_not_depend_on_the_style_of_the_notebook(
    tmp_path: Path, with_truth: Findings
) -> None:
    import matplotlib as mpl
    import matplotlib.style

    def draw(name: str) -> list[bytes]:
        draw_comparison(tmp_path / f"c{name}.png", with_truth)
        draw_theta(tmp_path / f"t{name}.png", with_truth)
        return [(tmp_path / f"{kind}{name}.png").read_bytes() for kind in "ct"]

    plain = draw("plain")
    with mpl.rc_context():
        matplotlib.style.use("dark_background")
        mpl.rcParams["savefig.bbox"] = "tight"
        assert draw("dark") == plain


def test_matplotlib_waits_until_a_picture_is_drawn_and_pyplot_is_left_alone() -> None:
    program = """
import sys
from pathlib import Path
from tomoslam_stage.comparison import canvas
assert not {"matplotlib", "scipy", "PIL"} & set(sys.modules)
canvas.write_atomically = lambda path, content: print(len(content))
figure = canvas.new_figure(1)
canvas.panel(figure, canvas.Box(1, 0.1, 1, 0.5))
canvas.save(figure, Path("never"))
assert "matplotlib.figure" in sys.modules
assert "matplotlib.pyplot" not in sys.modules
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert int(done.stdout) > 500


@pytest.mark.parametrize("which", ["findings", "kept_findings", "with_truth"])
def test_theta_is_drawn_whole_for_every_verdict(
    tmp_path: Path, which: str, request: pytest.FixtureRequest
) -> None:
    draw_theta(tmp_path / "t.png", request.getfixturevalue(which))
    assert_nothing_is_cut_off(tmp_path / "t.png")


def test_a_kept_correction_is_drawn_otherwise_than_an_accepted_one(
    tmp_path: Path, findings: Findings, kept_findings: Findings
) -> None:
    draw_theta(tmp_path / "accepted.png", findings)
    draw_theta(tmp_path / "kept.png", kept_findings)
    blue = [int(c) for c in bytes.fromhex(canvas.REFINED[1:])]
    upper = slice(200, 500)
    accepted, kept = (pixels(tmp_path / f"{n}.png")[upper] for n in ("accepted", "kept"))
    assert (accepted == blue).all(axis=-1).sum() > 1000
    assert (kept == blue).all(axis=-1).sum() < 100


@pytest.mark.parametrize("projections", [1, 3])
def test_a_tiny_scan_without_any_correction_is_drawn(
    tmp_path: Path, tiny: Callable[[int], Findings], projections: int
) -> None:
    findings = tiny(projections)
    draw_theta(tmp_path / "t.png", findings)
    draw_comparison(tmp_path / "c.png", findings)
    for name in "tc":
        assert_nothing_is_cut_off(tmp_path / f"{name}.png")


def test_a_very_long_reason_is_broken_into_lines(tmp_path: Path, kept_findings: Findings) -> None:
    long = replace(kept_findings.refinement, reason="0.123456 deg is more than 0.1 deg; " * 20)
    draw_theta(tmp_path / "t.png", replace(kept_findings, refinement=long))
    draw_comparison(tmp_path / "c.png", replace(kept_findings, refinement=long))
    for name in "tc":
        assert_nothing_is_cut_off(tmp_path / f"{name}.png")


@pytest.mark.parametrize(
    ("recorded", "label"),
    [
        (np.array([0.0, 0.1, 0.2]), "recorded angle / °"),
        (np.array([0.2, 0.1, 0.0]), "recorded angle / °"),
        (np.array([0.0, 0.2, 0.1]), "projection"),
    ],
)
def test_angles_out_of_order_are_drawn_along_the_scan(recorded: Floats, label: str) -> None:
    along, said = abscissa(recorded)
    assert said == label
    assert np.all(np.diff(along) > 0) == (not (recorded[0] > recorded[-1]))
