"""tomopy's functions, and HTTomo's loader, as entries; `stand_in_functions` stand in for tomopy."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tomoslam_stage import scans
from tomoslam_stage.errors import PipelineError, StageError
from tomoslam_stage.pipeline import check, check_on_scan, load_pipeline, run
from tomoslam_stage.products import Scan
from tomoslam_stage.scans import ScanContent, create_scan, open_scan
from tomoslam_stage.stages import MODULES, Work

pytestmark = pytest.mark.usefixtures("stand_in_functions")

NORMALIZE, STRIPE = "tomopy.prep.normalize", "tomopy.prep.stripe"
OURS, LOADERS = "tomoslam_stage.stages", "httomo.data.hdf.loaders"
LOAD = ("load_scan", OURS, "{}")
HTTOMO = ("standard_tomo", LOADERS, "{data_path: exchange/data, rotation_angles: auto}")
CENTER = ("find_center_vo", "tomopy.recon.rotation")


def entries(*said: tuple[str, ...]) -> Any:
    lines = []
    for method, module, parameters, *more in said:
        lines += [f"- method: {method}", f"  module_path: {module}", f"  parameters: {parameters}"]
        lines += [f"  {line}" for line in more]
    Path("mine.yaml").write_text("\n".join(lines) + "\n")
    return load_pipeline("mine.yaml")


@pytest.fixture
def scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """40 projections of 12 x 24 px in counts, with two groups of flats alike."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(8)
    beam, dark = rng.uniform(900, 1100, (12, 24)), rng.uniform(9, 11, (12, 24))
    integrals = np.zeros((40, 12, 24))
    integrals[:, :, 6:18] = rng.uniform(0.1, 0.9, (40, 12, 12))
    content = ScanContent(
        projections=beam * np.exp(-integrals) + dark,
        flats=np.stack([beam + dark] * 3),
        darks=np.stack([dark] * 2),
        theta_deg=np.arange(40) * 4.5,
    )
    create_scan(tmp_path / "scan.h5", content)
    return tmp_path / "scan.h5"


def ran(path: Path, *said: tuple[str, ...]) -> Scan:
    work = Work(path=path, folder=path.parent / "report", dry_run=True)
    run(entries(*said), work, MODULES)
    assert work.scan is not None
    return work.scan


def values(scan: Scan) -> Any:
    return scan.source.read(np.arange(scan.n_projections), np.arange(scan.n_rows))


def refused(*said: tuple[str, ...], path: Path | None = None) -> str:
    written = entries(*said)
    with pytest.raises(StageError) as caught:
        check(written, MODULES) if path is None else check_on_scan(written, MODULES, path)
    return str(caught.value)


def test_httomo_loader_and_preparation_give_the_line_integrals_of_our_own_loader(
    scan: Path,
) -> None:
    prepared = ran(scan, HTTOMO, ("normalize", NORMALIZE, "{}"), ("minus_log", NORMALIZE, "{}"))
    assert prepared.values == "line_integrals"
    np.testing.assert_allclose(values(prepared), values(open_scan(scan)), atol=2e-5)


def test_httomo_loader_leaves_the_counts(scan: Path) -> None:
    loaded = ran(scan, HTTOMO)
    assert loaded.values == "counts"
    assert values(loaded).max() > 900
    assert loaded.raw is not None
    assert loaded.raw.flats is not None
    assert loaded.raw.flats.shape == (3, 12, 24)


def test_what_the_entries_leave_out_is_done_before_refinement(scan: Path) -> None:
    work = Work(path=scan, folder=scan.parent / "report", dry_run=True)
    run(entries(HTTOMO), work, MODULES)
    np.testing.assert_array_equal(values(work.line_integrals()), values(open_scan(scan)))


def test_normalized_projections_still_get_their_logarithm(scan: Path) -> None:
    work = Work(path=scan, folder=scan.parent / "report", dry_run=True)
    run(entries(HTTOMO, ("normalize", NORMALIZE, "{}")), work, MODULES)
    assert work.scan is not None
    assert work.scan.values == "transmission"
    np.testing.assert_allclose(values(work.line_integrals()), values(open_scan(scan)), atol=2e-5)


def test_a_function_for_sinograms_sees_whole_rows_whatever_the_blocks(
    scan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scans.spool, "BLOCK_PIXELS", 2 * 40 * 24)
    stand_in = import_module(STRIPE).remove_stripe_based_sorting
    cleaned = ran(scan, LOAD, ("remove_stripe_based_sorting", STRIPE, "{size: 3}"))
    np.testing.assert_allclose(
        values(cleaned), stand_in(values(open_scan(scan)), size=3), atol=1e-6
    )


def test_the_scan_and_the_report_folder_hold_nothing_of_the_preparation(scan: Path) -> None:
    before = scan.read_bytes()
    ran(scan, LOAD, ("remove_stripe_based_sorting", STRIPE, "{}"))
    assert scan.read_bytes() == before
    assert list((scan.parent / "report").iterdir()) == []


def test_a_found_axis_is_a_side_output_that_later_entries_refer_to(scan: Path) -> None:
    center = (*CENTER, "{ind: mid}", "id: centering", "side_outputs: {cor: centre_of_rotation}")
    axis = "{axis: '${{centering.side_outputs.centre_of_rotation}}', width: 64}"
    refine = ("refine_theta", OURS, axis)
    work = Work(path=scan, folder=scan.parent / "report", dry_run=True)
    run(entries(LOAD, center, refine), work, MODULES)
    row = values(open_scan(scan))[:, 6].sum(axis=0)
    expected = (row * np.arange(24)).sum() / row.sum()
    assert work.refinement is not None
    assert work.refinement.axes["recorded"] == pytest.approx(expected, abs=1e-4)


def test_a_found_axis_is_told_in_columns_of_the_file(scan: Path) -> None:
    center = (*CENTER, "{}", "id: centering", "side_outputs: {cor: axis}")
    load = ("load_scan", OURS, "{binning: 2}")
    refine = ("refine_theta", OURS, "{axis: '${{centering.side_outputs.axis}}', width: 64}")
    work = Work(path=scan, folder=scan.parent / "report", dry_run=True)
    run(entries(load, center, refine), work, MODULES)
    assert work.refinement is not None
    assert work.refinement.axes["recorded"] == pytest.approx(5.5, abs=1)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (
            (LOAD, ("normalize", NORMALIZE, "{}")),
            "mine.yaml:4: normalize takes counts, and gets line integrals here. "
            "Leave it out, or put it elsewhere.",
        ),
        (
            (HTTOMO, ("minus_log", NORMALIZE, "{}"), ("minus_log", NORMALIZE, "{}")),
            "mine.yaml:7: minus_log takes transmission, and gets line integrals here. "
            "Leave it out, or put it elsewhere.",
        ),
        (
            (LOAD, ("remove_stripe_based_sorting", STRIPE, "{siez: 3}")),
            "mine.yaml:6: remove_stripe_based_sorting: no parameter 'siez'. Did you mean 'size'?",
        ),
        (
            (LOAD, ("remove_outlier", "tomopy.misc.corr", "{}")),
            "mine.yaml:4: remove_outlier.dif: is missing; a value is needed.",
        ),
        (
            (LOAD, (*CENTER, "{smin: left}")),
            "mine.yaml:6: find_center_vo.smin.int: 'left' does not fit: Input should be a valid "
            "integer, unable to parse string as an integer.",
        ),
        (
            (LOAD, ("remove_large_strip", STRIPE, "{}")),
            "mine.yaml:4: tomopy.prep.stripe has no method 'remove_large_strip'. "
            "Did you mean 'remove_large_stripe'?",
        ),
        (
            (LOAD, ("stripes_detect3d", STRIPE, "{}")),
            "mine.yaml:4: tomopy.prep.stripe.stripes_detect3d can be no entry: "
            "it needs the whole stack at once.",
        ),
        (
            (LOAD, ("remove_stripe_fw", "tomopy.prep.stripes", "{}")),
            "mine.yaml:5: the module_path 'tomopy.prep.stripes' is not taken. "
            "Did you mean 'tomopy.prep.stripe'?",
        ),
        (
            (LOAD, (*CENTER, "{}", "side_outputs: {centre: axis}")),
            "mine.yaml:7: find_center_vo has no side output 'centre'. Known: cor.",
        ),
    ],
)
@pytest.mark.usefixtures("scan")
def test_a_wrong_entry_is_refused_before_any_work(said: Any, message: str) -> None:
    assert refused(*said) == message


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (
            (LOAD, (*CENTER, "{ind: 12}")),
            "mine.yaml:6: find_center_vo.ind: 12; a row between 0 and 11, or mid, is needed.",
        ),
        (
            (HTTOMO, ("minus_log", NORMALIZE, "{}")),
            "mine.yaml:4: minus_log takes transmission, and gets counts here. "
            "Leave it out, or put it elsewhere.",
        ),
        (
            (LOAD, ("refine_theta", OURS, "{axis: 99}")),
            "mine.yaml:6: refine_theta.axis: 99; a column between 0 and 23 is needed for scan.h5.",
        ),
    ],
)
def test_a_pipeline_that_does_not_fit_a_scan_is_told_where(
    scan: Path, said: Any, message: str
) -> None:
    assert refused(*said, path=scan) == message


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("{rotation_angles: {user_defined: {}}}", "rotation_angles: {'user_defined': {}}; auto"),
        ("{flats: {file: 3, data_path: /a}}", "flats: {'file': 3, 'data_path': '/a'}; null, or"),
        ("{darks: ignore}", "darks: 'ignore'; null, or `file: input_data`"),
        ("{preview: {detector_y: {start: 3}}}", "preview: {'detector_y': {'start': 3}}; null"),
    ],
)
@pytest.mark.usefixtures("scan")
def test_what_httomo_loads_and_we_do_not_is_refused(parameters: str, message: str) -> None:
    said = refused(("standard_tomo", LOADERS, parameters))
    assert said.startswith(f"mine.yaml:3: standard_tomo.{message}")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("{data_path: entry1/data}", "data_path: 'entry1/data'; auto or /exchange/data is needed"),
        ("{rotation_angles: a}", "rotation_angles: 'a'; auto or /exchange/theta is needed"),
        ("{image_key_path: entry1/key}", "image_key_path: 'entry1/key'; null is needed"),
        (
            "{darks: {file: input_data, data_path: /a}}",
            "darks.data_path: '/a'; auto or /exchange/data_dark is needed",
        ),
        (
            "{flats: {file: other.h5, data_path: /exchange/data_white}}",
            "flats.file: 'other.h5'; input_data is needed, or the path of",
        ),
    ],
)
def test_a_path_that_the_scan_does_not_have_is_refused(
    scan: Path, parameters: str, message: str
) -> None:
    said = refused(("standard_tomo", LOADERS, parameters), path=scan)
    assert message in said


@pytest.mark.usefixtures("scan")
def test_httomo_sweeps_are_refused_by_name() -> None:
    with pytest.raises(PipelineError) as caught:
        entries(LOAD, ("remove_stripe_based_sorting", STRIPE, "{size: !Sweep [3, 5]}"))
    assert str(caught.value) == (
        "mine.yaml:6: !Sweep is not taken: one run refines a scan with one value of each "
        "parameter. Give one value, and run once for each of the others."
    )


RECON = "tomopy.recon.algorithm"
BEFORE = (LOAD, ("refine_theta", OURS, "{}"))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("{algorithm: gridrek}", "algorithm: tomopy has no 'gridrek'. Did you mean 'gridrec'?"),
        (
            "{algorithm: gridrec, num_iter: 5}",
            "recon: tomopy takes no num_iter for gridrec. Known: filter_name.",
        ),
        (
            "{algorithm: gridrec, filter_name: parsen}",
            "recon.filter_name: no filter 'parsen'. Did you mean 'parzen'?",
        ),
        ("{algorithm: sirt}", "recon: sirt iterates; num_iter is needed."),
        (
            "{algorithm: tv, num_iter: 5, num_gridx: 64}",
            "recon.num_gridx: 64 does not fit: Input should be None.",
        ),
        (
            "{algorithm: sirt, num_itr: 5}",
            "recon: no parameter 'num_itr'. Did you mean 'num_iter'?",
        ),
    ],
)
@pytest.mark.usefixtures("scan")
def test_a_wrong_recon_entry_is_refused_before_any_work(parameters: str, message: str) -> None:
    said = refused(*BEFORE, ("recon", RECON, parameters))
    assert said.partition(": ")[2] == message


@pytest.mark.usefixtures("scan")
def test_recon_needs_refined_angles() -> None:
    assert refused(LOAD, ("recon", RECON, "{algorithm: gridrec}")) == (
        "mine.yaml:4: recon needs the refinement, which no earlier entry makes. "
        "Put refine_theta before it."
    )


def test_a_search_that_expects_half_a_turn_warns_of_a_whole_one(
    scan: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ran(scan, LOAD, (*CENTER, "{}"))
    assert not [r for r in caplog.records if "half a turn" in r.message]
    with h5py.File(scan, "r+") as file:
        file["exchange/theta"][:] = np.arange(40) * 9.0
    ran(scan, LOAD, (*CENTER, "{}"))
    assert "find_center_vo expects half a turn, and scan.h5 spans 351 degrees" in caplog.text
