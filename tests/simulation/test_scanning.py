from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tomoslam_stage.errors import PipelineError
from tomoslam_stage.simulation import Recipe, recipe_from, simulate
from tomoslam_stage.simulation.angle_errors import Eccentric, LostStep
from tomoslam_stage.simulation.grains import Grains
from tomoslam_stage.simulation.scanning import nominal_angles

SMALL = {"phantom": {"method": "grains", "grains": 40}, "rows": 40, "columns": 64}


def small(**changes: object) -> Recipe:
    return recipe_from({**SMALL, "n_projections": 12, **changes})


def test_projections_come_out_the_same_in_any_order_and_in_another_run() -> None:
    one, other = simulate(small(seed=5)), simulate(small(seed=5))
    forwards = list(one.projections())
    for k in (7, 0, 11, 7):
        np.testing.assert_array_equal(other.projection(k), forwards[k])
    np.testing.assert_array_equal(one.whites, other.whites)
    np.testing.assert_array_equal(one.darks, other.darks)
    np.testing.assert_array_equal(one.theta_true, other.theta_true)


def test_another_seed_changes_noise_and_angles_but_not_the_object() -> None:
    one, other = simulate(small(seed=5)), simulate(small(seed=6))
    assert not np.array_equal(one.projection(0), other.projection(0))
    assert not np.array_equal(one.theta_true, other.theta_true)
    np.testing.assert_array_equal(one.line_integrals(0), other.line_integrals(0))


def test_noise_differs_from_projection_to_projection_of_the_same_view() -> None:
    scan = simulate(small(span_deg=720.0, n_projections=2 * 12, angle_errors=[]))
    np.testing.assert_allclose(scan.line_integrals(3), scan.line_integrals(15), atol=1e-9)
    assert not np.array_equal(scan.projection(3), scan.projection(15))


@pytest.mark.parametrize(
    ("span", "endpoint", "last"),
    [(360.0, False, 359.0), (180.0, False, 179.5), (180.0, True, 180.0), (720.0, False, 718.0)],
)
def test_last_angle_stops_short_of_the_span_unless_the_endpoint_is_wanted(
    span: float, endpoint: bool, last: float
) -> None:
    theta = np.rad2deg(nominal_angles(Recipe(span_deg=span, endpoint=endpoint)))
    assert theta[0] == 0
    assert theta[-1] == pytest.approx(last)
    np.testing.assert_allclose(np.diff(theta), theta[1])


@pytest.mark.parametrize("n", [12, 14])
def test_interlaced_sweeps_fill_the_gaps_of_one_another(n: int) -> None:
    theta = nominal_angles(small(n_projections=n, order="interlaced", passes=4))
    np.testing.assert_allclose(np.sort(theta), nominal_angles(small(n_projections=n)))
    assert (np.diff(theta) < 0).sum() == 3


def test_golden_angles_leave_no_large_gap_after_any_number_of_projections() -> None:
    theta = np.rad2deg(nominal_angles(small(n_projections=89, order="golden", span_deg=180.0)))
    assert theta[1] == pytest.approx(111.246, abs=1e-3)
    for n in (21, 55, 89):
        assert np.diff(np.sort(theta[:n])).max() < 3 * 180 / n


def test_angle_errors_add_up() -> None:
    both = [
        {"method": "lost_step", "size_deg": 1.0, "projection": 6},
        {"method": "eccentric", "amplitude_deg": 0.5},
    ]
    scan = simulate(small(angle_errors=both))
    nominal, rng = scan.theta_recorded, np.random.default_rng(0)
    lost = LostStep(size_deg=1.0, projection=6).disturb(nominal, rng) - nominal
    wobble = Eccentric(amplitude_deg=0.5).disturb(nominal, rng) - nominal
    np.testing.assert_allclose(scan.theta_true - nominal, lost + wobble)


def test_recorded_angles_are_true_where_nothing_errs() -> None:
    scan = simulate(small(angle_errors=[]))
    np.testing.assert_array_equal(scan.theta_true, scan.theta_recorded)


@pytest.mark.parametrize("offset", [-9.0, 6.5])
def test_object_stays_in_view_about_an_axis_out_of_the_middle(offset: float) -> None:
    scan = simulate(small(axis_offset=offset, roll_deg=2.0))
    assert scan.axis == 31.5 + offset
    mass = [scan.line_integrals(k).sum() for k in range(12)]
    assert np.ptp(mass) < 5e-3 * np.mean(mass)
    assert all(not scan.line_integrals(k)[:, [0, -1]].any() for k in range(12))


def test_slice_and_projection_show_the_same_object() -> None:
    scan = simulate(small(angle_errors=[], axis_offset=2.0))
    rows = np.arange(18, 22, 0.125) + 0.0625 - 0.5
    slab = np.mean([scan.slice_at(row, 64) for row in rows], axis=0).sum(axis=0)
    seen = scan.line_integrals(0)[18:22].mean(axis=0)
    np.testing.assert_allclose(slab[2:-2], seen[4:], atol=0.03 * seen.max())


def test_description_makes_the_same_recipe_again() -> None:
    recipe = small(
        angle_errors=["jitter", {"method": "lost_step", "size_deg": 2.0}],
        detector={"counts": 15_000.0},
        seed=9,
    )
    plain = recipe.described()
    assert plain["phantom"]["method"] == "grains"
    assert [error["method"] for error in plain["angle_errors"]] == ["jitter", "lost_step"]
    assert recipe_from(plain) == recipe


def test_default_recipe_is_the_card_with_an_encoder_walk() -> None:
    assert recipe_from({}) == Recipe()
    assert recipe_from({"phantom": "card", "angle_errors": ["walk"]}) == Recipe()


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ({"phantom": "grain"}, r"recipe\.phantom: .*Did you mean 'grains'"),
        ({"angle_errors": ["jiter"]}, r"recipe\.angle_errors: .*Did you mean 'jitter'"),
        ({"detector": {"count": 5.0}}, r"recipe\.detector: .*Did you mean 'counts'"),
        ({"collumns": 320}, r"recipe: .*Did you mean 'columns'"),
        ({"n_projections": 1}, r"recipe\.n_projections: 1 does not fit"),
    ],
)
def test_unknown_names_are_answered_with_the_nearest(spec: dict[str, object], says: str) -> None:
    with pytest.raises(PipelineError, match=says):
        recipe_from(spec)


def test_axis_outside_the_detector_is_refused() -> None:
    with pytest.raises(PipelineError, match=r"axis at column 71\.5 px of 64 leaves no room"):
        simulate(small(axis_offset=40.0))


def test_a_phantom_of_ones_own_can_be_scanned() -> None:
    class Two:
        def solids(self) -> object:
            return Grains(grains=2).solids()

    scan = simulate(Recipe(phantom=Two(), rows=20, columns=32, n_projections=3))
    assert scan.line_integrals(0).max() > 0


def test_simulating_needs_neither_files_nor_vision() -> None:
    code = (
        "import sys; from tomoslam_stage.simulation import Recipe, simulate;"
        "simulate(Recipe(rows=20, columns=32)).projection(0);"
        "print({'h5py', 'cv2', 'gtsam', 'finufft', 'matplotlib'} & set(sys.modules))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "set()"


def test_a_sample_that_jitters_moves_along_the_columns_and_nothing_else_changes() -> None:
    still, jittered = simulate(small(seed=5)), simulate(small(seed=5, shift_px=0.5))
    assert not still.shift.any()
    assert 0.2 < np.std(jittered.shift) < 0.8
    np.testing.assert_array_equal(still.theta_true, jittered.theta_true)
    columns = np.arange(64)
    for k in (0, 7):
        there = jittered.line_integrals(k).sum(axis=0)
        middle = (there * columns).sum() / there.sum()
        back = replace(jittered, shift=np.zeros(12)).line_integrals(k).sum(axis=0)
        apart = middle - (back * columns).sum() / back.sum()
        assert apart == pytest.approx(jittered.shift[k], abs=0.05)


def test_a_sample_that_jitters_stays_in_view() -> None:
    assert small(shift_px=2.0).field_radius == small().field_radius - 6
