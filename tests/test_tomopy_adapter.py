from __future__ import annotations

import inspect
import os
import sys
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tomoslam_stage import tomopy_adapter
from tomoslam_stage.errors import BackendMissingError, PipelineError
from tomoslam_stage.tomopy_adapter import ALLOWED, REFUSED, analytic, installed
from tomoslam_stage.tomopy_adapter.recon import THREADS

if TYPE_CHECKING:
    from conftest import Blobs

NORMALIZE, CORR = "tomopy.prep.normalize", "tomopy.misc.corr"
REAL = tomopy_adapter.version()
real = pytest.mark.skipif(
    REAL is None or "stand-in" in REAL, reason="tomopy itself is not installed"
)
FUNCTIONS = [(path, name) for path, functions in ALLOWED.items() for name in functions]
STACKS = [(path, name) for path, name in FUNCTIONS if not ALLOWED[path][name].finds]
GIVEN: dict[str, dict[str, Any]] = {
    "adjust_range": {"dmin": 0.7, "dmax": 1.2},
    "distortion_correction_proj": {"xcenter": 20.0, "ycenter": 6.0, "list_fact": [1.0, 1e-3]},
    "normalize": {"flat": np.full((2, 12, 40), 2.0), "dark": np.full((2, 12, 40), 0.1)},
    "normalize_roi": {"roi": [2, 2, 9, 9]},
    "remove_outlier": {"dif": 0.1},
}
"""What functions need to be told."""


class StandInTomopy:
    """A stand-in for tomopy: it takes note of calls and reconstructs nothing."""

    def __init__(self) -> None:
        self.calls: list[SimpleNamespace] = []

    def recon(self, tomo: Any, theta: Any, **keywords: Any) -> Any:
        called = SimpleNamespace(tomo=tomo, theta=theta, threads=os.environ[THREADS], **keywords)
        called.begun = keywords["init_recon"].copy()
        self.calls.append(called)
        keywords["init_recon"] -= 1
        return keywords["init_recon"]

    def normalize_bg(self, tomo: Any, air: int = 1, ncore: Any = None, nchunk: Any = None) -> Any:
        self.calls.append(SimpleNamespace(air=air, ncore=ncore, nchunk=nchunk))
        tomo *= 2
        return tomo.astype(np.float64)

    def minus_log(self, arr: Any, ncore: Any = None, out: Any = None) -> Any:
        self.calls.append(SimpleNamespace(ncore=ncore, out=out))
        return arr[1:]

    def normalize(self, arr: Any, flat: Any, dark: Any, cutoff: Any = None) -> Any:
        self.calls.append(SimpleNamespace(arr=arr, flat=flat, dark=dark, cutoff=cutoff))
        raise ValueError("operands could not be broadcast")

    def find_center(self, tomo: Any, theta: Any, ind: Any = None, sinogram_order: Any = 0) -> Any:
        self.calls.append(SimpleNamespace(tomo=tomo, theta=theta, ind=ind, order=sinogram_order))
        return np.array([21.5])


@pytest.fixture
def stand_in_tomopy(
    monkeypatch: pytest.MonkeyPatch,
    fresh_import: None,  # noqa: ARG001
) -> StandInTomopy:
    """tomopy is not needed: a stand-in takes its place in `sys.modules`."""
    stand_in = StandInTomopy()
    contents: dict[str, dict[str, Any]] = {
        "tomopy.prep": {},
        "tomopy": {"__version__": "1.15.2 stand-in", "recon": stand_in.recon},
        NORMALIZE: {
            "normalize_bg": stand_in.normalize_bg,
            "minus_log": stand_in.minus_log,
            "normalize": stand_in.normalize,
        },
        "tomopy.recon.rotation": {"find_center": stand_in.find_center},
        "tomopy.recon.algorithm": {
            "allowed_recon_kwargs": {"sirt": ["num_iter"], "gridrec": ["filter_name"]},
            "allowed_accelerated_kwargs": {"sirt": ["accelerated"]},
        },
    }

    for path, names in contents.items():
        module = ModuleType(path)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, path, module)
    package = ModuleType("tomopy.recon")  # the name of a function in tomopy itself
    monkeypatch.setitem(sys.modules, "tomopy.recon", package)
    return stand_in


@pytest.mark.usefixtures("no_tomopy")
def test_without_tomopy_there_is_no_version_and_the_message_says_how_to_get_it() -> None:
    assert tomopy_adapter.version() is None
    with pytest.raises(BackendMissingError, match="conda install -c conda-forge tomopy") as caught:
        tomopy_adapter.require("paper.yaml: line 7")
    assert str(caught.value).startswith("paper.yaml: line 7: tomopy is needed")
    assert caught.value.exit_code == 5


@pytest.mark.usefixtures("no_tomopy")
def test_without_tomopy_names_are_checked_and_keywords_are_not_guessed() -> None:
    assert tomopy_adapter.allowed(NORMALIZE, "minus_log", "line 3").along == "projection"
    assert tomopy_adapter.along(CORR, "median_filter", {"axis": 1}) == "row"
    for ask in (tomopy_adapter.keywords, tomopy_adapter.fills):
        with pytest.raises(BackendMissingError):
            ask(NORMALIZE, "minus_log")
    with pytest.raises(BackendMissingError):
        tomopy_adapter.recon_keywords("sirt")


@pytest.mark.parametrize(
    ("path", "name", "said"),
    [
        ("tomopy.prep.norm", "minus_log", "Did you mean 'tomopy.prep.normalize'"),
        (NORMALIZE, "minus_logg", "Did you mean 'minus_log'"),
        ("tomopy.prep.stripe", "stripes_detect3d", "needs the whole stack at once"),
        ("tomopy.recon.rotation", "write_center", "writes files"),
        (NORMALIZE, "__import__", "has no function"),
    ],
)
def test_what_is_not_allowed_is_refused_with_a_reason_or_the_nearest_name(
    path: str, name: str, said: str
) -> None:
    with pytest.raises(PipelineError, match=r"^line 3: ") as caught:
        tomopy_adapter.allowed(path, name, "line 3")
    assert said in str(caught.value)


def test_no_function_is_both_allowed_and_refused() -> None:
    for path, functions in ALLOWED.items():
        assert not set(functions) & set(REFUSED.get(path, {}))


@pytest.mark.parametrize("axis", [2, -1, "auto"])
def test_a_filter_across_all_blocks_is_refused(axis: object) -> None:
    with pytest.raises(PipelineError, match=r"median_filter\.axis"):
        tomopy_adapter.along(CORR, "median_filter", {"axis": axis})


def test_a_user_sets_what_is_neither_the_stack_nor_filled_in(
    stand_in_tomopy: StandInTomopy,  # noqa: ARG001
) -> None:
    assert list(tomopy_adapter.keywords(NORMALIZE, "normalize")) == ["cutoff"]
    assert tomopy_adapter.fills(NORMALIZE, "normalize") == {"flat", "dark"}
    assert list(tomopy_adapter.keywords(NORMALIZE, "normalize_bg")) == ["air"]
    assert tomopy_adapter.fills(NORMALIZE, "normalize_bg") == {"ncore"}
    assert list(tomopy_adapter.keywords("tomopy.recon.rotation", "find_center")) == ["ind"]
    assert tomopy_adapter.recon_keywords("sirt") == {"num_iter", "accelerated"}
    with pytest.raises(PipelineError, match="Did you mean 'gridrec'"):
        tomopy_adapter.recon_keywords("gridrek")


def test_a_call_fills_the_cores_and_leaves_the_block_as_it_is(
    stand_in_tomopy: StandInTomopy,
) -> None:
    block = np.ones((3, 2, 4), np.float32)
    made = tomopy_adapter.call(NORMALIZE, "normalize_bg", block, air=5)
    np.testing.assert_array_equal(block, 1)
    np.testing.assert_array_equal(made, 2 * block)
    assert isinstance(made, np.ndarray)
    assert made.dtype == np.float32
    assert stand_in_tomopy.calls == [SimpleNamespace(air=5, ncore=os.cpu_count(), nchunk=None)]


def test_a_search_for_the_axis_gets_the_mean_of_its_rows_and_gives_a_number(
    stand_in_tomopy: StandInTomopy,
) -> None:
    block = np.stack([np.full((3, 4), 1.0), np.full((3, 4), 2.0)], axis=1).astype(np.float32)
    theta = np.arange(3.0)
    found = tomopy_adapter.call("tomopy.recon.rotation", "find_center", block, theta=theta, ind=1)
    (called,) = stand_in_tomopy.calls
    assert found == 21.5
    assert called.ind == 0
    assert called.theta is theta
    np.testing.assert_array_equal(called.tomo, np.full((3, 1, 4), 1.5))


@pytest.mark.parametrize(
    ("name", "said"), [("minus_log", r"made \(2, 2, 4\)"), ("normalize", "tomopy says: operands")]
)
def test_a_changed_shape_or_a_failure_in_tomopy_is_a_mistake_in_the_pipeline(
    stand_in_tomopy: StandInTomopy,  # noqa: ARG001
    name: str,
    said: str,
) -> None:
    fields = {"flat": 1, "dark": 0} if name == "normalize" else {}
    with pytest.raises(PipelineError, match=said):
        tomopy_adapter.call(NORMALIZE, name, np.ones((3, 2, 4), np.float32), **fields)


@pytest.mark.usefixtures("stand_in_tomopy")
@pytest.mark.parametrize("order", [[0, 1, 2], [0, 1, 2, 2], [1, 2, 3, 4]])
def test_an_order_of_projections_that_leaves_one_out_is_refused(order: list[int]) -> None:
    with pytest.raises(PipelineError, match="each of 0 to 3 is needed once"):
        tomopy_adapter.iterate(SINOGRAMS, THETA, 4.0, "osem", {"ind_block": order})


def test_regularisation_is_filled_up_and_the_prior_is_as_large_as_the_grid(
    stand_in_tomopy: StandInTomopy,
) -> None:
    tomopy_adapter.iterate(SINOGRAMS[:1], THETA, 2.7, "tikh", {"reg_par": 0.5, "num_iter": 3})
    (called,) = stand_in_tomopy.calls
    np.testing.assert_array_equal(called.reg_par, [0.5] + [1.0] * 9)
    assert called.reg_data.shape == called.begun.shape == (1, 14, 14)
    np.testing.assert_allclose(called.begun, 1e-6)
    assert called.num_iter == 3


SINOGRAMS = np.ones((3, 4, 10), np.float32)
THETA = np.array([9.0, 0.5, -1.0, 2.0])


def test_tomopy_gets_angles_the_other_way_round_within_a_turn_on_one_thread(
    stand_in_tomopy: StandInTomopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(THREADS, "7")
    tomopy_adapter.gridrec(SINOGRAMS, THETA, 4.0, "hann")
    (called,) = stand_in_tomopy.calls
    np.testing.assert_allclose(called.theta, np.mod(-THETA, 2 * np.pi))
    assert called.sinogram_order is True
    assert called.ncore == 1
    assert called.threads == "1"
    assert os.environ[THREADS] == "7"


def test_fbp_back_projects_two_sets_of_rays_between_the_columns_onto_the_same_slices(
    stand_in_tomopy: StandInTomopy,
) -> None:
    slices = tomopy_adapter.fbp(SINOGRAMS, THETA, 4.0, "ram-lak")
    first, second = stand_in_tomopy.calls
    assert slices.shape == (3, 10, 10)
    assert first.tomo.shape == (3, 4, 16)
    assert (first.center, second.center) == (8.25, 7.75)
    assert not first.begun.any()
    np.testing.assert_array_equal(second.begun, -1)


def test_gridrec_gets_twice_the_width_up_to_a_power_of_two_about_its_own_axis(
    stand_in_tomopy: StandInTomopy,
) -> None:
    slices = tomopy_adapter.gridrec(SINOGRAMS, THETA, 4.0, "ram-lak")
    (called,) = stand_in_tomopy.calls
    assert slices.shape == (3, 10, 10)
    assert called.tomo.shape == (3, 4, 32)
    assert (called.center, called.filter_name) == (16, "none")


@pytest.mark.parametrize(("nonnegative", "calls", "each"), [(True, 5, 1), (False, 1, 5)])
def test_sirt_is_constrained_between_iterations_and_sees_all_the_detector_sees(
    stand_in_tomopy: StandInTomopy, nonnegative: bool, calls: int, each: int
) -> None:
    slices = tomopy_adapter.sirt(SINOGRAMS[:1], THETA, 2.7, 5, nonnegative)
    assert slices.shape == (1, 10, 10)
    assert [called.num_iter for called in stand_in_tomopy.calls] == [each] * calls
    for called in stand_in_tomopy.calls:
        assert called.center == pytest.approx(3.2)
        assert called.num_gridx == 14  # the axis is 1.8 px off the middle
        assert not called.begun.any()
    assert slices.max() == (0 if nonnegative else -1)


def test_the_prolate_function_is_its_own_transform() -> None:
    x = np.linspace(-0.999, 0.999, 4001)
    wave = analytic.prolate(x)
    at = np.array([0.0, 0.2, 0.5])
    transform = np.trapezoid(wave * np.cos(analytic.BANDWIDTH * at[:, None] * x), x)
    np.testing.assert_allclose(transform / transform[0], analytic.prolate(at), atol=1e-4)


@real
@pytest.mark.parametrize("path", sorted(REFUSED.keys() | ALLOWED.keys()))
def test_every_public_function_of_tomopy_is_either_allowed_or_refused(path: str) -> None:
    public = set(installed.module(path).__all__) - {"recon"}
    assert ALLOWED.get(path, {}).keys() | REFUSED.get(path, {}).keys() == public


@real
@pytest.mark.parametrize(("path", "name"), FUNCTIONS)
def test_every_allowed_function_has_the_parameters_that_are_filled_or_withheld(
    path: str, name: str
) -> None:
    how = ALLOWED[path][name]
    parameters = inspect.signature(getattr(installed.module(path), name)).parameters
    assert set(how.filled) | set(how.withheld) <= set(parameters)
    assert how.by_axis == ("axis" in parameters)


@real
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(("path", "name"), STACKS)
def test_blocks_give_what_the_whole_stack_gives(path: str, name: str) -> None:
    stack = np.random.default_rng(5).uniform(0.5, 1.5, (30, 12, 40)).astype(np.float32)
    stack[3, 4, 5] = np.nan if name in ("remove_nan", "median_filter_nonfinite") else 1
    given = GIVEN.get(name, {})
    whole = tomopy_adapter.call(path, name, stack, **given)
    axis = 0 if tomopy_adapter.along(path, name, given) == "projection" else 1
    blocks = np.array_split(stack, 3, axis)
    made = [tomopy_adapter.call(path, name, block, **given) for block in blocks]
    assert np.isfinite(whole).all()
    assert name in ("remove_neg",) or not np.array_equal(whole, stack)
    np.testing.assert_array_equal(np.concatenate(made, axis), whole)


@real
def test_a_filter_of_rows_gives_by_row_what_the_whole_stack_gives() -> None:
    stack = np.random.default_rng(5).uniform(0.5, 1.5, (30, 12, 40)).astype(np.float32)
    for name in ("median_filter", "gaussian_filter", "remove_outlier"):
        given = {**GIVEN.get(name, {}), "axis": 1}
        whole = tomopy_adapter.call(CORR, name, stack, **given)
        blocks = np.array_split(stack, 3, axis=1)
        made = [tomopy_adapter.call(CORR, name, block, **given) for block in blocks]
        np.testing.assert_array_equal(np.concatenate(made, axis=1), whole)


@real
@pytest.mark.filterwarnings("ignore:Please import:DeprecationWarning")
@pytest.mark.parametrize("name", ["find_center", "find_center_vo"])
def test_tomopy_finds_the_axis_as_a_column_of_ours(name: str, dots: Blobs) -> None:
    theta = np.arange(180) * np.pi / 180
    rows = dots.sinograms(theta, 45.5, 96).transpose(1, 0, 2)
    given = {"theta": theta, "tol": 0.1} if name == "find_center" else {"smin": -10, "smax": 10}
    found = tomopy_adapter.call("tomopy.recon.rotation", name, rows[:, :1], **given)
    assert found == pytest.approx(45.5, abs=0.3)


@real
@pytest.mark.parametrize("columns", [96, 101])
def test_a_disc_has_its_value_in_gridrec_from_the_middle_to_its_edge(columns: int) -> None:
    from_middle = np.arange(columns) - (columns - 1) / 2
    fine = from_middle[:, None] + (np.arange(16) - 7.5) / 16
    chords = np.mean(2 * np.sqrt(np.maximum(40**2 - fine**2, 0)), axis=1).astype(np.float32)
    sinograms = np.broadcast_to(chords, (3, 180, columns))
    theta = np.arange(180) * np.pi / 180
    slices = tomopy_adapter.gridrec(sinograms, theta, (columns - 1) / 2, "hann")
    distance = np.hypot(from_middle[:, None], from_middle)
    for low, high, value in [(0, 10, 1), (10, 20, 1), (20, 30, 1), (30, 36, 1), (44, 47, 0)]:
        ring = slices[:, (distance >= low) & (distance < high)].mean(axis=1)
        np.testing.assert_allclose(ring, value, atol=0.004)


@real
@pytest.mark.parametrize(
    "algorithm", ["art", "bart", "mlem", "osem", "ospml_quad", "pml_quad", "grad", "tikh", "tv"]
)
def test_whatever_else_tomopy_iterates_puts_blobs_where_they_are(
    algorithm: str, blobs: Blobs
) -> None:
    theta = np.random.default_rng(3).permutation(np.arange(60) * np.pi / 60)
    parameters: dict[str, Any] = {"num_iter": 20}
    if algorithm in ("grad", "tikh"):
        parameters["reg_par"] = [-1.0, 0.0]  # steps as it sees fit, no regularisation
    elif algorithm in ("ospml_quad", "pml_quad", "tv"):
        parameters["reg_par"] = 1e-3
    sinograms = blobs.sinograms(theta, 22.7, 49)[:2]
    found = tomopy_adapter.iterate(sinograms, theta, 22.7, algorithm, parameters)
    truth = blobs.slices(49)[:2]
    for image, wanted in zip(found, truth, strict=True):
        assert np.corrcoef(image.ravel(), wanted.ravel())[0, 1] > 0.9
