"""What is put into the page, without looking at it."""

from __future__ import annotations

import json
import re
import zlib
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tomoslam_stage.comparison import Findings, Run, report
from tomoslam_stage.comparison.logbook import draw_logbook
from tomoslam_stage.comparison.measures import measures
from tomoslam_stage.comparison.page import contents, write_page
from tomoslam_stage.comparison.page import viewers as viewers_module
from tomoslam_stage.comparison.page.contents import pipeline_yaml
from tomoslam_stage.comparison.page.movie import FRAMES, MOST_SIGHTINGS, movie
from tomoslam_stage.comparison.page.viewers import by_angle, sinogram_viewer, slices_viewer
from tomoslam_stage.pipeline import check, described, load_pipeline
from tomoslam_stage.products import Event, Pixels, Scan, Tracks
from tomoslam_stage.stages import MODULES


def made(findings: Findings) -> dict[str, Any]:
    return contents(findings, report(findings, Run(pipeline=[{"method": "load_scan"}])))


def unpacked(part: dict[str, Any], name: str) -> Pixels:
    """Read a layer as the page does."""
    planes = np.frombuffer(zlib.decompress(b64decode(part["layers"][name])), np.uint8)
    low, high = planes.reshape(2, part["height"], part["width"]).astype(np.float64)
    start, end = part["limits"]
    return np.asarray(start + (low + 256 * high) / 65535 * (end - start), np.float32)


def tracks_of(sightings: int, features: int) -> Tracks:
    rng = np.random.default_rng(4)
    feature = np.sort(rng.integers(0, features, sightings))
    place = rng.uniform(0, 15, sightings)
    return Tracks(feature, rng.integers(0, 90, sightings), 3 * place, place, np.full(90, 100))


def test_the_page_is_one_file_that_asks_for_nothing(tmp_path: Path, complete: Findings) -> None:
    write_page(tmp_path / "report.html", made(complete))
    text = (tmp_path / "report.html").read_text("utf-8")
    assert list(tmp_path.iterdir()) == [tmp_path / "report.html"]
    assert "default-src 'none'" in text
    assert "{{" not in text.split('id="data"')[0]
    references = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert all(reference.startswith(("#", "data:")) for reference in references)
    assert len(text) < 3_000_000


def test_a_name_that_a_user_chose_stays_a_name(tmp_path: Path, findings: Findings) -> None:
    name = "</script><script>alert({{data}})</script>&.h5"
    scan = replace(findings.scan, name=name)
    write_page(tmp_path / "report.html", made(replace(findings, scan=scan)))
    text = (tmp_path / "report.html").read_text("utf-8")
    assert "<script>alert" not in text
    data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["report"]["scan"]["name"] == name


def test_slices_keep_their_values_to_a_part_in_65535_of_their_range(complete: Findings) -> None:
    viewer = slices_viewer(complete)
    assert viewer is not None
    assert list(viewer["names"]) == ["recorded", "refined", "true"]
    assert viewer["stacks"][viewer["first"]]["label"] == "detector row 7"
    for k, stack in enumerate(viewer["stacks"]):
        step = (stack["limits"][1] - stack["limits"][0]) / 65535
        x, z, radius = stack["circle"]
        rows, columns = np.mgrid[: stack["height"], : stack["width"]]
        inside = np.hypot(rows - z, columns - x) <= radius
        for name in viewer["names"]:
            slices = complete.reconstructions[name].slices
            wrong = np.abs(unpacked(stack, name) - slices[k])[inside]
            assert wrong.max() < 0.6 * step
            assert stack["detail"] is None


def test_slices_too_large_for_a_page_are_shrunk_and_the_change_is_shown_in_full(
    complete: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewers_module, "MOST_PIXELS", 20_000)
    monkeypatch.setattr(viewers_module, "LARGEST_DETAIL", 24)
    viewer = slices_viewer(complete)
    assert viewer is not None
    stack = viewer["stacks"][viewer["first"]]
    assert (stack["width"], stack["pixel"]) == (40, [2, 2])
    detail, (left, top) = stack["detail"], stack["detail"]["origin"]
    assert left <= 52 < left + 24
    assert top <= 30 < top + 24
    full = complete.reconstructions["refined"].slices[1, top : top + 24, left : left + 24]
    np.testing.assert_allclose(unpacked(detail, "refined"), full, atol=1e-5)
    halved = complete.reconstructions["refined"].slices[1].reshape(40, 2, 40, 2).mean(axis=(1, 3))
    middle = slice(10, 30)
    np.testing.assert_allclose(
        unpacked(stack, "refined")[middle, middle], halved[middle, middle], atol=1e-5
    )


def test_of_many_slices_the_most_changed_are_shown_in_the_order_of_their_rows(
    findings: Findings,
) -> None:
    some = {}
    for name, one in findings.reconstructions.items():
        many = np.concatenate([one.slices, one.slices, one.slices])
        some[name] = replace(one, slices=many, rows=np.arange(9))
    viewer = slices_viewer(replace(findings, reconstructions=some))
    assert viewer is not None
    labels = [stack["label"] for stack in viewer["stacks"]]
    assert len(labels) == viewers_module.MOST_SLICES
    assert {"detector row 1", "detector row 4", "detector row 7"} <= set(labels)
    assert labels == sorted(labels)


def test_without_a_correction_nothing_refined_is_shown(findings: Findings) -> None:
    still = replace(findings.refinement, refined=findings.refinement.recorded.copy(), status="kept")
    shown = made(replace(findings, refinement=still))
    assert list(shown["slices"]["names"]) == ["recorded"]
    assert shown["correction"] is shown["sinogram"] is None
    assert shown["slice_charts"] == []
    assert [series["style"] for series in shown["residuals"]["series"]] == ["recorded"]
    assert all("refined" not in measure["values"] for measure in shown["measures"])


def test_a_scan_in_which_nothing_was_found_still_has_a_page(
    tmp_path: Path, tiny: Callable[[int], Findings]
) -> None:
    for projections in (1, 3):
        write_page(tmp_path / "report.html", made(tiny(projections)))
    shown = made(replace(tiny(3), reconstructions={}))
    assert shown["slices"] is None
    assert shown["movie"]["tracks"] is None


def test_projections_are_read_one_by_one_and_told_in_the_order_of_their_angles(
    findings: Findings,
) -> None:
    # The source of these findings refuses to read more than one projection or row at once.
    order = np.random.default_rng(3).permutation(90)
    refinement = replace(findings.refinement, recorded=findings.refinement.recorded[order])
    shown = movie(replace(findings, refinement=refinement))
    assert len(shown["frames"]) == len(shown["names"]) == FRAMES
    assert all(frame.startswith("data:image/jpeg;base64,") for frame in shown["frames"])
    assert np.all(np.diff(shown["angles"]) > 0)


def test_sightings_are_told_by_feature_and_angle_in_px_of_the_movie(findings: Findings) -> None:
    class Wide:
        shape = (90, 1000, 30)

        def read(self, projections: Any, rows: Any) -> Pixels:
            return np.zeros((len(projections), len(rows), 30), np.float32)

    scan = Scan(Wide(), findings.refinement.recorded, np.arange(90))
    tracks = tracks_of(300, 20)
    shown = movie(replace(findings, scan=scan, tracks=tracks))
    told = shown["tracks"]
    assert (told["features"], told["sightings"], told["every"]) == (20, 300, 1)
    assert (shown["height"], shown["width"]) == (250, 7)
    feature, rank = (
        np.frombuffer(zlib.decompress(b64decode(told[key])), np.int32)
        for key in ("feature", "rank")
    )
    assert np.all(np.diff(feature * 1000 + rank) >= 0)
    row = np.frombuffer(zlib.decompress(b64decode(told["row"])), np.float32)
    # The centre of a pixel of the movie lies between pixels 1 and 2 of the scan.
    np.testing.assert_allclose(np.sort(row), np.sort((tracks.row - 1.5) / 4), rtol=1e-5)
    assert told["residual"] is None


def test_projections_are_named_by_their_number_in_the_file(findings: Findings) -> None:
    frames = np.delete(np.arange(91), 40)
    events = (Event(50, 0.3, 7.0, "lost step"),)
    shown = made(
        replace(
            findings,
            scan=replace(findings.scan, frames=frames),
            refinement=replace(findings.refinement, events=events),
        )
    )
    assert shown["movie"]["names"][0] == "projection 0"
    assert shown["movie"]["names"][-1] == "projection 90"
    (mark,) = shown["correction"]["marks"]
    assert mark["label"].endswith("before projection 51")


def test_of_too_many_sightings_whole_features_are_left_out(findings: Findings) -> None:
    told = movie(replace(findings, tracks=tracks_of(3 * MOST_SIGHTINGS, 90)))["tracks"]
    feature = np.frombuffer(zlib.decompress(b64decode(told["feature"])), np.int32)
    assert told["every"] == 3
    assert set(feature) == set(range(0, 90, 3))


def test_residuals_that_do_not_belong_to_the_sightings_are_not_shown(findings: Findings) -> None:
    tracks = tracks_of(300, 20)
    for many, shown in ((300, True), (299, False)):
        refinement = replace(findings.refinement, histograms={"sighting_residuals": np.ones(many)})
        told = movie(replace(findings, refinement=refinement, tracks=tracks))["tracks"]
        assert (told["residual"] is not None) == shown


def test_a_sinogram_by_angle_is_straight_where_the_angles_are_right() -> None:
    theta = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 60))
    sinogram = np.tile(theta[:, None], (1, 4)).astype(np.float32)
    even = by_angle(sinogram, theta)
    np.testing.assert_allclose(np.diff(even[:, 0]), np.ptp(theta) / 59, rtol=1e-3)
    np.testing.assert_allclose(even[[0, -1], 0], theta[[0, -1]], rtol=1e-6)
    np.testing.assert_array_equal(by_angle(sinogram[::-1], theta[::-1]), even)


def test_the_sinogram_is_that_of_an_unused_row(findings: Findings) -> None:
    viewer = sinogram_viewer(findings)
    assert viewer is not None
    assert viewer["row"] == "detector row 8, a row that was not used"
    used = replace(findings.refinement, heldout_rows=np.empty(0, np.intp))
    viewer = sinogram_viewer(replace(findings, refinement=used))
    assert viewer is not None
    assert viewer["row"] == "detector row 7, a row that was used"


def test_the_pipeline_on_the_page_can_be_run_again(tmp_path: Path) -> None:
    def as_run(name: str) -> list[dict[str, Any]]:
        entries = load_pipeline(name)
        built = check(entries, MODULES)
        return [described(entry, stage) for entry, stage in zip(entries, built, strict=True)]

    for name in ("default", "paper"):
        (tmp_path / "again.yaml").write_text(pipeline_yaml({"pipeline": as_run(name)}))
        assert as_run(str(tmp_path / "again.yaml")) == as_run(name)


def test_the_measures_that_decide_come_first_and_all_say_what_they_mean(
    complete: Findings,
) -> None:
    told = measures(complete)
    assert [measure.decides for measure in told] == sorted(
        (measure.decides for measure in told), reverse=True
    )
    assert sum(measure.decides for measure in told) == 2
    assert all(measure.note.endswith(".") for measure in told)
    assert {"PSNR", "SSIM", "contrast"} <= {measure.name for measure in told}


def test_the_page_for_the_logbook_has_the_shape_of_a4(tmp_path: Path, complete: Findings) -> None:
    from PIL import Image

    for name, findings in {
        "whole": complete,
        "bare": replace(complete, reconstructions={}),
    }.items():
        draw_logbook(tmp_path / f"{name}.png", findings, Run())
        with Image.open(tmp_path / f"{name}.png") as image:
            width, height = image.size
            inches = [side / dots for side, dots in zip(image.size, image.info["dpi"], strict=True)]
        assert height / width == pytest.approx(2**0.5, rel=1e-3)
        assert inches == pytest.approx([210 / 25.4, 297 / 25.4], rel=1e-3)
