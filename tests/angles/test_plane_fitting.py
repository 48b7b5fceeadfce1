from __future__ import annotations

import numpy as np
import pytest

from tomoslam_stage.angles.plane import fit_plane, fit_robustly, normal_of
from tomoslam_stage.geometry import triangle_angles

SCATTER = 0.4
"""px"""


def at(*steps: float) -> np.ndarray:
    """(3,) radians: three angles, `steps` degrees apart."""
    return 0.4 + np.deg2rad(np.cumsum([0, *steps]))


def ordinary(columns: np.ndarray) -> np.ndarray:
    """(2,) radians: steps from ordinary least squares of x3 on x1 and x2."""
    known = np.column_stack([columns[:, :2], np.ones(len(columns))])
    (m, k, _), *_ = np.linalg.lstsq(known, columns[:, 2], rcond=None)
    return triangle_angles(np.array([[-m, -k, 1]]))[0]


def through_the_origin(columns: np.ndarray) -> np.ndarray:
    """(2,) radians: steps of the plane by total least squares that has no offset."""
    normal = np.linalg.svd(columns, full_matrices=False)[2][-1]
    return triangle_angles(normal[None] / normal[2])[0]


@pytest.mark.parametrize("steps", [(4, 4), (5, 5), (10, 10), (40, 40), (4, 7), (31, 12)])
@pytest.mark.parametrize("axis", [0.0, 5.0])
def test_steps_are_exact_on_columns_without_error(
    columns, steps: tuple[float, float], axis: float
) -> None:
    for direction in (1, -1):
        turned = direction * np.array(steps)
        plane = fit_plane(columns(at(*turned), 30, 1) + axis)
        found, _ = plane.steps()
        np.testing.assert_allclose(np.rad2deg(found), steps, atol=1e-4)
        assert plane.alternates
        assert plane.scatter < 1e-5
        assert np.abs(plane.residuals(columns(at(*turned), 30, 2) + axis)).max() < 1e-4


def noisy(radius: float, trials: int, count: int = 250) -> np.ndarray:
    """(trial, t, 3) px: features of random places in a disc at 4 degree steps, with scatter."""
    rng = np.random.default_rng(11)
    distance = radius * np.sqrt(rng.random((trials, count, 1)))
    phase = rng.uniform(0, 2 * np.pi, (trials, count, 1))
    return distance * np.cos(at(4, 4) - phase) + rng.normal(0, SCATTER, (trials, count, 3))


def test_total_least_squares_has_no_bias_where_ordinary_has_a_tenth_of_a_degree() -> None:
    parts = noisy(radius=62, trials=2500)
    # Both are skewed where the noise is this large: the median tells the bias.
    by_ordinary = np.rad2deg(np.nanmedian([ordinary(part) for part in parts])) - 4
    by_total = np.rad2deg(np.nanmedian([fit_plane(part).steps()[0] for part in parts])) - 4
    assert 0.07 < by_ordinary < 0.17
    assert abs(by_total) < 0.04


@pytest.fixture(scope="module")
def trials() -> np.ndarray:
    """(trial, t, 3) px: see `noisy`."""
    return noisy(radius=120, trials=600)


def test_an_axis_that_is_wrong_by_five_px_is_harmless(trials: np.ndarray) -> None:
    right, wrong = (
        np.rad2deg([fit_plane(part).steps()[0] for part in columns])
        for columns in (trials, trials + 5)
    )
    np.testing.assert_allclose(wrong, right, atol=1e-6)


@pytest.mark.parametrize("step", [10.0, 40.0])
def test_without_the_offset_a_wrong_axis_would_do_harm(columns, step: float) -> None:
    exact = columns(at(step, step), 100, 1) + 5
    error = np.rad2deg(through_the_origin(exact)) - step
    fitted = np.rad2deg(fit_plane(exact).steps()[0]) - step
    assert np.abs(error).max() > 0.02
    assert np.abs(fitted).max() < 1e-4


@pytest.mark.parametrize("steps", [(4, 4), (10, 10), (40, 40), (4, 7), (-5, -9)])
def test_normal_of_two_steps_is_that_of_their_features(columns, steps: tuple[float, float]) -> None:
    fitted = fit_plane(columns(at(*steps), 30, 1)).normal
    normal, derivative = normal_of(np.deg2rad(steps))
    assert abs(normal @ fitted) == pytest.approx(1, abs=1e-9)
    for k, change in enumerate(1e-6 * np.eye(2)):
        there, back = (normal_of(np.deg2rad(steps) + sign * change)[0] for sign in (1, -1))
        np.testing.assert_allclose(derivative[:, k], (there - back) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("steps", [(4, 4), (10, 10), (40, 40), (4, 7)])
def test_linearised_steps_are_exact_where_they_are_expected(
    columns, steps: tuple[float, float]
) -> None:
    plane = fit_plane(columns(at(*steps), 30, 1) + 5)
    found, _ = plane.steps_near(np.deg2rad(steps))
    np.testing.assert_allclose(np.rad2deg(found), steps, atol=1e-6)
    near, _ = plane.steps_near(np.deg2rad(steps) * 1.01)
    np.testing.assert_allclose(near, np.deg2rad(steps), rtol=2e-3)


def test_linearised_steps_have_no_bias_where_cosines_leave_their_range() -> None:
    planes = [fit_plane(part) for part in noisy(radius=40, trials=600)]
    closed = np.array([plane.steps()[0] for plane in planes])
    near = np.rad2deg([plane.steps_near(np.deg2rad([4, 4]))[0] for plane in planes])
    assert np.isnan(closed).any()
    assert np.isfinite(near).all()
    assert abs(near.mean() - 4) < 4 * near.std() / np.sqrt(len(planes))


@pytest.mark.parametrize("linearised", [False, True])
def test_predicted_covariance_is_the_scatter_that_is_seen(
    trials: np.ndarray, linearised: bool
) -> None:
    planes = [fit_plane(part) for part in trials]
    expected = np.deg2rad([4, 4])
    found = [plane.steps_near(expected) if linearised else plane.steps() for plane in planes]
    seen = np.cov(np.array([steps for steps, _ in found]).T)
    said = np.median([covariance for _, covariance in found], axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(said)), np.sqrt(np.diag(seen)), rtol=0.12)
    correlation = [c[0, 1] / np.sqrt(c[0, 0] * c[1, 1]) for c in (seen, said)]
    assert correlation[0] == pytest.approx(correlation[1], abs=0.1)


def test_scatter_is_that_of_the_columns(trials: np.ndarray) -> None:
    scatter = np.mean([fit_plane(part).scatter for part in trials])
    assert scatter == pytest.approx(SCATTER, rel=0.02)


def test_few_tracks_do_not_look_better_than_they_are() -> None:
    rng = np.random.default_rng(0)
    phase = rng.uniform(0, 2 * np.pi, (2000, 6, 1))
    noisy = 80 * np.cos(at(10, 10) - phase) + rng.normal(0, SCATTER, (2000, 6, 3))
    variance = np.mean([fit_plane(part).scatter ** 2 for part in noisy])
    assert np.sqrt(variance) == pytest.approx(SCATTER, rel=0.05)


def test_a_plane_of_no_triangle_does_not_alternate() -> None:
    x1, x2 = np.random.default_rng(0).normal(0, 40, (2, 50))
    assert not fit_plane(np.stack([x1, x2, 0.5 * x1 + 0.3 * x2], axis=1)).alternates
    assert not fit_plane(np.stack([x1, x2, -0.9 * x1 - 1.8 * x2], axis=1)).alternates


def test_outliers_among_the_chosen_are_dropped_and_good_tracks_found(columns) -> None:
    rng = np.random.default_rng(2)
    tracks = columns(at(5, 5), 100, 1) + rng.normal(0, 0.1, (100, 3))
    tracks[:20, 2] += rng.choice([-1, 1], 20) * rng.uniform(4, 20, 20)
    start = np.zeros(100, bool)
    start[15:50] = True
    plane, inliers = fit_robustly(tracks, start)
    assert not inliers[:20].any()
    assert inliers[20:].mean() > 0.95
    assert plane.scatter == pytest.approx(0.1, rel=0.25)
    again = fit_plane(tracks[inliers])
    np.testing.assert_array_equal(plane.normal, again.normal)


def test_tracks_without_error_stay_inliers(columns) -> None:
    _, inliers = fit_robustly(columns(at(5, 5), 30, 1), np.arange(30) < 10)
    assert inliers.all()
