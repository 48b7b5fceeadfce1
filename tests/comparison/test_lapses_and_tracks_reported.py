"""What the sources, the stage and the tracks tell in summary, report and picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tomoslam_stage.comparison import Findings, Run, canvas, draw_theta, report, summary
from tomoslam_stage.comparison.events import draw_events, labelled, place
from tomoslam_stage.comparison.histograms import (
    HISTOGRAMS_HEIGHT,
    histograms_of,
    lengths_histogram,
    residuals_histogram,
)
from tomoslam_stage.comparison.report import write_shifts
from tomoslam_stage.comparison.theta_picture import draw_correction
from tomoslam_stage.products import Event, Floats, Refinement, Rigidity, StageNoise

LOST = Event(40, -1.5, 31.0, "lost step")
LEFT_OUT = "left out: some projections fit 3.1 times worse than usual"


def events(*projections: int) -> tuple[Event, ...]:
    """Make events that are the surer the later they are."""
    return tuple(Event(p, 0.3, 6.0 + p / 10, "backlash") for p in projections)


def drawn_tracks() -> dict[str, Floats]:
    rng = np.random.default_rng(2)
    residuals = np.append(rng.normal(0, 0.2, 4000), np.full(40, 9.0))
    return {"track_lengths": rng.geometric(0.03, 300) + 7.0, "sighting_residuals": residuals}


def words(findings: Findings) -> str:
    return " ".join(summary(report(findings, Run())).split())


def test_whether_features_keep_their_rows_is_told(findings: Findings) -> None:
    evidence = findings.refinement.evidence
    assert evidence is not None
    assert "with depth" not in words(findings)
    told = replace(evidence, rigidity=Rigidity(321, 0.1234, 9.04, -0.251, -3.0))
    refinement = replace(findings.refinement, evidence=told)
    assert (
        "those of 321 features move by 0.12 px as the scan goes on (9.0 standard errors), by "
        "0.25 px with depth (3.0)"
    ) in words(replace(findings, refinement=refinement))


def pixels(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


@pytest.fixture
def by_sources(findings: Findings) -> Findings:
    """Findings of a refinement by features and map, all fields filled."""
    refinement = replace(
        findings.refinement,
        sources={"features": "used", "map": LEFT_OUT},
        events=(LOST,),
        roll=np.radians(0.0984),
        stage_noise=StageNoise(np.radians(0.05), np.radians(0.0123)),
        histograms=drawn_tracks(),
    )
    return replace(findings, refinement=refinement)


def changed(findings: Findings, **fields: object) -> Findings:
    return replace(findings, refinement=replace(findings.refinement, **fields))  # type: ignore[arg-type]


def test_the_report_tells_sources_events_and_stage_in_plain_values(by_sources: Findings) -> None:
    made = report(by_sources, Run())
    assert made["sources"] == {"features": "used", "map": LEFT_OUT}
    assert made["events"] == [
        {"projection": 40, "size_deg": -1.5, "significance": 31.0, "kind": "lost step"}
    ]
    assert made["stage"] == pytest.approx(
        {
            "walk_deg": 0.05,
            "jitter_deg": 0.0123,
            "roll_deg": 0.0984,
            "shift_px": None,
            "shift_sigma_px": None,
        }
    )


def test_the_report_says_which_angle_was_held_and_how(
    by_sources: Findings, findings: Findings, tiny: Callable[[int], Findings]
) -> None:
    joint, triplets = (report(one, Run())["gauge"] for one in (by_sources, findings))
    for said in (joint, triplets):
        assert said.startswith("the first angle is held where it was recorded; a common angle")
        assert "mirror image cannot be seen" in said
    assert joint.endswith("out of sigma; solved together with the angles: axis, roll")
    assert "sigma is counted from the first angle" in triplets
    assert report(tiny(3), Run())["gauge"] is None


def test_the_summary_of_a_long_scan_says_that_key_projections_were_asked(
    by_sources: Findings,
) -> None:
    long = changed(by_sources, counts={"key projections": 1500})
    told = "of 1500 key projections, the others placed in their map"
    assert told in " ".join(words(long).split())
    assert told not in " ".join(words(by_sources).split())
    unanswered = changed(long, sources={"map": LEFT_OUT}, reason=f"map {LEFT_OUT}")
    assert " sources " not in words(unanswered)


def test_what_was_neither_looked_for_nor_found_is_empty_or_null(findings: Findings) -> None:
    made = report(findings, Run())
    assert made["sources"] == {}
    assert made["events"] == []
    assert set(made["stage"].values()) == {None}
    said = words(findings)
    for label in ("sources", "events", "stage", "roll"):
        assert f" {label} " not in said


def test_shifts_of_projections_are_told_in_px_of_the_file(
    by_sources: Findings, tmp_path: Path
) -> None:
    shift = np.tile([0.2, -0.2], len(by_sources.refinement.recorded) // 2)
    sigma = np.full(len(shift), 0.03)
    jittered = changed(
        by_sources, shift=shift, shift_sigma=sigma, unknowns=("theta", "axis", "shift")
    )
    jittered = replace(jittered, scan=replace(jittered.scan, binning=2))
    made = report(jittered, Run())
    assert made["stage"]["shift_px"] == pytest.approx(0.4)
    assert made["stage"]["shift_sigma_px"] == pytest.approx(0.06)
    assert made["stage"]["roll_deg"] is None
    assert "together with the angles: axis, shift; held: roll; a shift of all" in made["gauge"]
    assert "projections shifted by 0.4 px rms" in words(jittered)
    write_shifts(tmp_path / "shift.txt", jittered)
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "shift.txt"), 2 * shift)
    write_shifts(tmp_path / "shift.txt", changed(jittered, status="kept"))
    assert not (tmp_path / "shift.txt").exists()


def test_no_roll_is_told_where_no_source_was_used(by_sources: Findings) -> None:
    unused = changed(by_sources, sources={"map": LEFT_OUT}, stage_noise=None)
    assert report(unused, Run())["stage"]["roll_deg"] is None
    assert " stage " not in words(unused)


def test_the_summary_tells_sources_events_and_stage_in_one_line_each(by_sources: Findings) -> None:
    said = words(by_sources)
    for part in (
        f"sources features used; map {LEFT_OUT} angles",
        "events lost step of -1.5 deg before projection 40 (31 sigma) stage",
        "error of the recorded steps: walk 0.05 deg a step, jitter 0.012 deg; roll of the axis "
        "0.098 deg axis",
    ):
        assert part in said
    assert "mirror" not in said
    assert max(map(len, summary(report(by_sources, Run())).splitlines()[:-1])) <= 100


def test_a_roll_of_nearly_nothing_has_no_sign(by_sources: Findings) -> None:
    assert "roll of the axis 0.000 deg" in words(changed(by_sources, roll=-1e-7))


def test_a_reason_that_names_the_sources_is_not_said_twice(by_sources: Findings) -> None:
    silent = {"map": "left out: the reconstruction says nothing about the angles"}
    said = words(changed(by_sources, sources=silent, reason=f"map {silent['map']}"))
    assert said.count("left out") == 1


def test_of_many_events_the_five_surest_are_told_in_their_order(by_sources: Findings) -> None:
    said = words(changed(by_sources, events=(LOST, *events(50, 55, 60, 65, 70, 75))))
    places = [said.find(f"before projection {p} ") for p in (40, 60, 65, 70, 75)]
    assert min(places) > 0
    assert places == sorted(places)
    assert "projection 50 " not in said
    assert "; and 2 more" in said
    assert "more" not in words(changed(by_sources, events=events(50, 55, 60, 65, 70)))


def marks_and_labels(findings: Findings) -> tuple[list[float], list[str]]:
    """Places of the lines, and labels, that the panel of the correction shows."""
    axes = canvas.panel(canvas.new_figure(4), canvas.Box(1, 1, 8, 2))
    draw_correction(axes, np.arange(90.0), findings)
    marks = [line for line in axes.lines if line.get_color() == canvas.MARK]
    return [float(np.mean(np.asarray(line.get_xdata()))) for line in marks], [
        t.get_text() for t in axes.texts
    ]


def test_an_event_is_marked_between_its_projections_and_named(by_sources: Findings) -> None:
    assert marks_and_labels(by_sources) == ([39.5], ["lost step −1.50°"])
    assert marks_and_labels(changed(by_sources, events=())) == ([], [])


def test_every_event_is_marked_but_labels_that_would_overlap_are_left_out(
    by_sources: Findings,
) -> None:
    crowd = changed(by_sources, events=events(20, 21, 50, 51, 52, 80))
    marks, labels = marks_and_labels(crowd)
    assert marks == [19.5, 20.5, 49.5, 50.5, 51.5, 79.5]
    named = labelled(np.arange(90.0), crowd.refinement.events)
    assert len(labels) == len(named) == 4
    # Two projections are just enough room for a label, and the surest comes first.
    assert [event.projection for event in named] == [80, 52, 50, 21]
    many = events(*range(1, 90, 10))
    assert len(labelled(np.arange(90.0), many)) == 5


def test_a_label_keeps_clear_of_the_curve() -> None:
    axes = canvas.panel(canvas.new_figure(4), canvas.Box(1, 1, 8, 2))
    axes.set_ylim(0, 1)
    change = np.where(np.arange(90) < 45, 0.9, 0.1)
    draw_events(axes, np.arange(90.0), change, events(20, 70))
    low, high = axes.texts[1], axes.texts[0]
    assert (low.get_verticalalignment(), high.get_verticalalignment()) == ("bottom", "top")


@pytest.mark.parametrize(("projection", "side"), [(1, "left"), (20, "right"), (89, "right")])
def test_a_label_stands_beside_its_line_and_inside_the_panel(projection: int, side: str) -> None:
    figure = canvas.new_figure(4)
    axes = canvas.panel(figure, canvas.Box(1, 1, 8, 2))
    axes.set_xlim(0, 89)
    draw_events(axes, np.arange(90.0), np.zeros(90), events(projection))
    figure.draw_without_rendering()
    (label,), box = axes.texts, axes.get_window_extent()
    assert label.get_horizontalalignment() == side
    drawn = label.get_window_extent()
    assert box.x0 <= drawn.x0 < drawn.x1 <= box.x1
    assert box.y0 <= drawn.y0 < drawn.y1 <= box.y1


def test_an_event_at_the_first_projection_has_a_place() -> None:
    assert place(np.array([3.0, 4.0]), Event(0, 1.0, 9.0, "lost step")) == 3


def test_one_sigma_is_drawn_as_a_band_of_its_width(findings: Findings) -> None:
    axes = canvas.panel(canvas.new_figure(4), canvas.Box(1, 1, 8, 2))
    draw_correction(axes, np.arange(90.0), findings)
    (band,) = [one for one in axes.collections if one.get_label() == "± 1 σ"]
    corners = np.asarray(band.get_paths()[0].vertices)
    at_ten = corners[corners[:, 0] == 10][:, 1]
    middle = np.degrees(findings.refinement.change[10])
    assert [at_ten.min(), at_ten.max()] == pytest.approx([middle - 0.02, middle + 0.02])


def test_tracks_are_counted_by_their_length() -> None:
    made = lengths_histogram(np.array([8.0, 8.0, 9.0, 30.0]))
    assert made.edges[[0, -1]].tolist() == [0.5, 30.5]
    assert made.counts[[6, 7, 8, 28, 29]].tolist() == [0, 2, 1, 0, 1]
    assert made.remark == "4 features, half of them with 8 or more"
    long = lengths_histogram(np.array([8.0, 721.0]))
    assert long.counts.sum() == 2
    assert len(long.counts) <= 40


def test_residuals_are_drawn_beside_a_normal_distribution_of_their_robust_scale() -> None:
    made = residuals_histogram(drawn_tracks()["sighting_residuals"])
    assert "4040 sightings, robust scale 0.2" in made.remark
    assert "1.0 % lie farther out" in made.remark
    assert made.normal is not None
    middle = abs(made.edges[1:] + made.edges[:-1]) < 0.6
    assert made.normal.sum() == pytest.approx(4040, rel=1e-3)
    assert made.counts[middle].sum() == pytest.approx(made.normal[middle].sum(), rel=0.05)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_residuals_that_are_all_alike_are_drawn(value: float) -> None:
    made = residuals_histogram(np.full(5, value))
    assert made.counts.sum() == 5
    assert (made.normal is None) == (value == 0)


def test_histograms_are_made_of_what_is_there(refinement: Refinement) -> None:
    def titles(histograms: dict[str, Floats]) -> list[str]:
        return [one.title for one in histograms_of(replace(refinement, histograms=histograms))]

    tracks = drawn_tracks()
    assert titles(tracks) == ["track lengths", "residuals of the sightings"]
    assert titles({"track_lengths": tracks["track_lengths"]}) == ["track lengths"]
    assert titles({name: np.empty(0) for name in tracks}) == []
    assert titles({"sighting_residuals": np.full(3, np.nan)}) == []
    assert titles({}) == []


def test_theta_grows_by_the_histograms_and_nothing_is_cut_off(
    tmp_path: Path, by_sources: Findings
) -> None:
    draw_theta(tmp_path / "with.png", changed(by_sources, events=events(*range(0, 90, 9))))
    draw_theta(tmp_path / "without.png", changed(by_sources, histograms={}))
    drawn, fewer = (pixels(tmp_path / f"{name}.png") for name in ("with", "without"))
    assert len(drawn) - len(fewer) == pytest.approx(HISTOGRAMS_HEIGHT * canvas.DPI, abs=1)
    for page in (drawn, fewer):
        frame = np.ones(page.shape[:2], bool)
        frame[3:-3, 3:-3] = False
        assert (page[frame] == 255).all()
