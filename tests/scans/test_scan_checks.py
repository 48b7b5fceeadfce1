from __future__ import annotations

import hashlib
import logging

import h5py
import numpy as np
import pytest

from tomoslam_stage.errors import ScanError
from tomoslam_stage.scans import describe_scan, open_scan
from tomoslam_stage.scans.theta import to_radians, unwrapped

DATA = np.full((12, 4, 16), 0.5)
THETA = np.arange(12) * 15.0

CASES = {
    "too few angles": (
        DATA,
        THETA[:11],
        {},
        "raw.h5: /exchange/theta holds 11 angles for 12 projections in /exchange/data; one per "
        "projection is needed. 1 cannot be told from 12 images. Pass --drop-frames with their "
        "numbers, counted from 0.",
    ),
    "nan": (
        DATA,
        np.where(THETA == 30, np.nan, THETA),
        {},
        "raw.h5: /exchange/theta holds 1 angles that are NaN or infinite, the first at frame 2; "
        "finite angles are needed. Repair theta, or pass --drop-frames 2.",
    ),
    "constant": (
        DATA,
        np.full(12, 7.0),
        {},
        "raw.h5: all 12 angles are 7 degrees; a turning stage is needed. Restore theta from the "
        "planned angles.",
    ),
    "repeated": (
        DATA,
        np.where(THETA == 45, 30, THETA),
        {},
        "raw.h5: 1 angles occur more than once, the first (30 degrees, 2 times) at frame 2; each "
        "angle once is needed. Average repeated frames, or repair theta, or pass --drop-frames 3.",
    ),
    "short arc": (
        DATA,
        np.arange(12) * 0.1,
        {},
        "raw.h5: theta spans 1.1 degrees; at least 10 are needed. If it holds radians, pass --set "
        "load_scan.units=rad.",
    ),
    "two-dimensional theta": (
        DATA,
        THETA[:, None],
        {},
        "raw.h5: /exchange/theta has the shape (12, 1); one dimension is needed.",
    ),
    "theta in words": (
        DATA,
        ["a"] * 12,
        {},
        "raw.h5: /exchange/theta holds texts or lists; real numbers are needed.",
    ),
    "flat data": (
        DATA[0],
        THETA,
        {},
        "raw.h5: /exchange/data has 2 dimensions (4, 16); three (projection, row, column) are "
        "needed.",
    ),
    "complex": (
        DATA.astype(complex),
        THETA,
        {},
        "raw.h5: /exchange/data holds complex numbers; integers or real numbers are needed. Store "
        "the intensity or the line integrals.",
    ),
    "one column": (
        DATA[..., :1],
        THETA,
        {},
        "raw.h5: /exchange/data holds 12 projections of 4 x 1 px; at least 3 of 1 x 8 px are "
        "needed.",
    ),
    "two projections": (
        DATA[:2],
        THETA[:2],
        {},
        "raw.h5: /exchange/data holds 2 projections of 4 x 16 px; at least 3 of 1 x 8 px are "
        "needed.",
    ),
    "other flats": (
        DATA,
        THETA,
        {"exchange__data_white": np.ones((2, 4, 15))},
        "raw.h5: /exchange/data_white has the shape (2, 4, 15); frames of 4 x 16 px, as in "
        "/exchange/data, are needed.",
    ),
    "dark flats": (
        DATA,
        THETA,
        {"exchange__data_white": np.zeros((2, 4, 16))},
        "raw.h5: the median of the flats minus the darks is 0 counts; flats brighter than the "
        "darks are needed. Check which of the two the beam was off for, or pass --set "
        "load_scan.kind=...",
    ),
    "counts without flats": (
        DATA * 1000,
        THETA,
        {},
        "raw.h5: /exchange/data holds values up to 500, which are counts, but there are no flats "
        "in /exchange/data_white; they are needed. Add flats, or pass --set "
        "load_scan.kind=transmission.",
    ),
    "cone beam": (
        DATA,
        THETA,
        {
            "measurement__instrument__source_object_distance": 0.05,
            "measurement__instrument__source_detector_distance": 0.25,
        },
        "raw.h5: a cone beam: the source is 50 mm before and the detector 200 mm behind the axis "
        "(magnification 5); a parallel beam is needed. Pass --parallel if the projections are "
        "parallel nevertheless.",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_fault_has_its_own_message_and_leaves_the_file_alone(raw_scan, case):
    data, theta, others, message = CASES[case]
    path = raw_scan(data, theta, **others)
    before = hashlib.sha256(path.read_bytes()).digest()
    with pytest.raises(ScanError) as error:
        open_scan(path)
    assert str(error.value) == message
    assert error.value.exit_code == 3
    assert describe_scan(path)["problems"] == [message]
    assert hashlib.sha256(path.read_bytes()).digest() == before


def test_files_that_cannot_be_opened_say_why(tmp_path, scan_file):
    (tmp_path / "text.h5").write_text("not HDF5")
    (tmp_path / "cut.h5").write_bytes(scan_file.read_bytes()[:3000])
    h5py.File(tmp_path / "bare.h5", "w").close()
    for name, message in {
        "none.h5": "none.h5: there is no such file. Looked for",
        "text.h5": "text.h5: it is not an HDF5 file",
        "cut.h5": "cut.h5: it is cut off: shorter than its own header says.",
        "bare.h5": "bare.h5: /exchange/data is missing. A DXchange file",
    }.items():
        with pytest.raises(ScanError) as error:
            open_scan(tmp_path / name)
        assert str(error.value).startswith(message)


def test_missing_link_targets_and_virtual_sources_are_named(tmp_path):
    layout = h5py.VirtualLayout((12, 4, 16), np.uint16)
    layout[:] = h5py.VirtualSource("gone.h5", "/exchange/data", (12, 4, 16))
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        file.create_virtual_dataset("/exchange/data", layout)
        file["/exchange/theta"] = THETA
    with h5py.File(tmp_path / "linked.h5", "w") as file:
        file["/exchange/data"] = h5py.ExternalLink("gone.h5", "/exchange/data")
    with pytest.raises(ScanError, match=r"/exchange/data draws on gone\.h5, which is missing"):
        open_scan(tmp_path / "virtual.h5")
    with pytest.raises(ScanError, match=r"is a link to /exchange/data in gone\.h5, which is mis"):
        open_scan(tmp_path / "linked.h5")


def distances(source_m, detector_m, pixel_um):
    return {
        "measurement__instrument__source__distance": -source_m,
        "measurement__instrument__detector__distance": detector_m,
        "measurement__instrument__detector__x_pixel_size": pixel_um * 1e-6,
    }


def test_a_synchrotron_with_distances_passes_for_parallel(raw_scan):
    # 16 columns of 6.5 um, 30 m from the source: the edge moves by 1e-5 px
    assert open_scan(raw_scan(DATA, THETA, **distances(30, 0.2, 6.5))).n_projections == 12


def test_a_cone_beam_is_opened_where_parallel_is_insisted_on(raw_scan):
    path = raw_scan(DATA, THETA, **distances(0.02, 0.2, 2000))
    with pytest.raises(ScanError, match=r"moving edge points by [\d.]+ px"):
        open_scan(path)
    assert open_scan(path, parallel=True).n_projections == 12


def test_a_declared_cone_beam_is_refused_without_any_distance(raw_scan):
    with pytest.raises(ScanError, match="declares a 'cone-beam' geometry"):
        open_scan(raw_scan(DATA, THETA, measurement__instrument__geometry=b"cone-beam"))


@pytest.mark.parametrize("units", ["rad", b"radians", np.array([b"Radian"])])
def test_radians_are_believed_where_the_file_says_so(raw_scan, units):
    scan = open_scan(raw_scan(DATA, np.radians(THETA), units))
    np.testing.assert_allclose(scan.theta, np.radians(THETA))


def test_units_are_guessed_with_a_warning_where_the_file_is_silent(raw_scan, caplog):
    degrees = open_scan(raw_scan(DATA, THETA.astype(np.float32), None)).theta
    radians = open_scan(raw_scan(DATA, np.radians(THETA), None)).theta
    np.testing.assert_allclose(degrees, radians)
    warned = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert warned == [
        "raw.h5: theta has no units; it spans 165, so it is taken as deg",
        "raw.h5: theta has no units; it spans 2.88, so it is taken as rad",
    ]


def test_unknown_units_are_refused_unless_overridden(raw_scan):
    path = raw_scan(DATA, THETA, "gon")
    with pytest.raises(ScanError, match="theta has the unit 'gon'; degrees or radians"):
        open_scan(path)
    np.testing.assert_allclose(open_scan(path, units="deg").theta, np.radians(THETA))


def test_a_full_turn_apart_is_not_the_same_angle(raw_scan):
    assert open_scan(raw_scan(DATA, np.linspace(0, 360, 12))).theta[-1] == pytest.approx(2 * np.pi)


def test_angles_stored_modulo_a_turn_get_their_turns_back():
    steady = np.arange(300) * 2.5 + 350
    np.testing.assert_allclose(unwrapped(steady % 360), steady)
    np.testing.assert_allclose(unwrapped(-steady % 360), 360 - steady)


@pytest.mark.parametrize(
    "angles",
    [
        np.arange(50) * 137.508 % 360,
        np.concatenate([np.arange(0, 180, 10.0), np.arange(5, 180, 10.0)]),
        np.random.default_rng(1).permutation(360).astype(float),
        np.arange(100) * 137.508,
    ],
)
def test_golden_interlaced_and_shuffled_angles_stay_as_stored(angles):
    np.testing.assert_array_equal(
        np.degrees(to_radians(angles, "deg")), np.degrees(np.radians(angles))
    )
