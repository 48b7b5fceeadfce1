from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from tomoslam_stage.comparison import Findings
from tomoslam_stage.comparison.edges import (
    Edge,
    edge_widths,
    feet,
    most_changed_edge,
    rise,
    widths_of_most_changed,
)
from tomoslam_stage.comparison.regions import disc, most_changed_material
from tomoslam_stage.products import Floats, Pixels

SIDE = 120
PLACES = np.arange(-100, 101) * 0.1
GAUSSIAN = 2.5631
"""10 to 90 % of a Gaussian edge, in units of its standard deviation."""


def half_plane(angle_deg: float, sigma: float, offset: float = 0.0) -> Pixels:
    """Draw material beyond a straight edge through the middle that faces `angle_deg` from x."""
    z, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    angle = np.radians(angle_deg)
    along = x * np.cos(angle) + z * np.sin(angle) - offset
    return np.asarray(0.5 + 0.5 * erf(along / (np.sqrt(2) * sigma)), np.float32)


def gaussian_edge(sigma: float, offset: float = 0.0) -> Floats:
    return np.asarray(0.5 + 0.5 * erf((PLACES - offset) / (np.sqrt(2) * sigma)))


@pytest.mark.parametrize("angle_deg", [0, 30, 135, 250])
def test_the_width_of_a_slanted_edge_does_not_depend_on_its_direction(angle_deg: float) -> None:
    recorded, refined = half_plane(angle_deg, 2.0), half_plane(angle_deg, 1.0)
    inside = disc(recorded.shape)
    window = most_changed_material(recorded, refined, inside)
    edge = most_changed_edge(recorded, refined, inside, window)
    assert edge is not None
    angle = np.radians(angle_deg)
    assert edge.direction == pytest.approx((np.sin(angle), np.cos(angle)), abs=0.03)
    profiles = {"recorded": edge.profile(recorded), "refined": edge.profile(refined)}
    widths = edge_widths(edge.places, profiles)
    assert widths["recorded"] == pytest.approx(2 * GAUSSIAN, rel=0.1)
    assert widths["refined"] == pytest.approx(GAUSSIAN, rel=0.1)


def test_a_line_ends_where_it_says_and_holds_what_lies_there() -> None:
    z, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    edge = Edge((50, 70), (0.6, 0.8), 5.0)
    assert edge.profile(2 * z + x) == pytest.approx(170 + edge.places * (2 * 0.6 + 0.8), abs=1e-3)
    assert edge.ends[0] == pytest.approx([47, 53])
    assert edge.ends[1] == pytest.approx([66, 74])
    assert edge.places[[0, -1]] == pytest.approx([-5, 5])


def test_the_edge_that_changed_is_found_and_not_a_steeper_one_that_did_not() -> None:
    z, x = np.mgrid[:SIDE, :SIDE]
    still = 3.0 * (np.hypot(z - 75, x - 75) < 9)
    moved = [1.0 * (np.hypot(z - 45, x - 45 - shift) < 9) for shift in (0, 1)]
    recorded, refined = (np.asarray(still + one, np.float32) for one in moved)
    inside = disc(recorded.shape)
    window = most_changed_material(recorded, refined, inside)
    edge = most_changed_edge(recorded, refined, inside, window)
    assert edge is not None
    assert np.hypot(edge.middle[0] - 45, edge.middle[1] - 45.5) == pytest.approx(9, abs=2)
    assert abs(edge.direction[1]) > 0.8


def test_there_is_no_edge_where_nothing_changed_or_no_line_fits() -> None:
    image = half_plane(0, 1.0)
    inside = disc(image.shape)
    window = most_changed_material(image, image, inside)
    assert most_changed_edge(image, image, inside, window) is None
    small = np.random.default_rng(1).random((9, 9)).astype(np.float32)
    inside = disc(small.shape)
    window = most_changed_material(small, 2 * small, inside)
    assert most_changed_edge(small, 2 * small, inside, window) is None


def test_both_angles_are_treated_alike() -> None:
    recorded, refined = half_plane(20, 2.0), half_plane(20, 1.0, offset=0.7)
    inside = disc(recorded.shape)
    window = most_changed_material((recorded + refined) / 2, recorded, inside)
    one = most_changed_edge(recorded, refined, inside, window)
    assert one == most_changed_edge(refined, recorded, inside, window)


def test_a_profile_begins_and_ends_where_it_is_flat() -> None:
    # A shelf before the edge, and a fall after it, belong to other edges.
    shelf = 2 * gaussian_edge(0.5, -6) + 3 * gaussian_edge(0.7) - 4 * gaussian_edge(0.5, 6)
    low, high = feet(shelf)
    assert low == pytest.approx(2, abs=0.1)
    assert high == pytest.approx(5, abs=0.1)


def test_a_shifted_edge_is_as_sharp_as_before() -> None:
    profiles = {"recorded": gaussian_edge(0.8), "refined": gaussian_edge(0.8, 0.6)}
    widths = edge_widths(PLACES, profiles)
    assert widths["refined"] == pytest.approx(widths["recorded"], rel=0.03)


def test_a_smeared_edge_is_not_sharp_because_it_rises_to_half_of_what_it_should() -> None:
    profiles = {"recorded": 0.4 * gaussian_edge(0.3), "refined": gaussian_edge(1.0)}
    assert np.isnan(edge_widths(PLACES, profiles)["recorded"])


def test_an_edge_that_falls_cannot_be_measured() -> None:
    assert np.isnan(rise(PLACES, gaussian_edge(1.0)[::-1]))
    falling = {"recorded": -PLACES, "refined": -PLACES}
    assert all(np.isnan(width) for width in edge_widths(PLACES, falling).values())


def test_the_rise_is_interpolated_between_samples() -> None:
    assert rise(np.arange(5.0), np.array([0, 0, 0.5, 1, 1.0])) == pytest.approx(1.6)


def test_the_report_measures_the_slice_that_changed_most(complete: Findings) -> None:
    made = complete.reconstructions
    widths = widths_of_most_changed(made)
    assert set(widths) == {"recorded", "refined", "true"}
    alone = {
        name: replace(made[name], slices=made[name].slices[1:2], rows=made[name].rows[1:2])
        for name in widths
    }
    assert widths_of_most_changed(alone) == pytest.approx(widths, nan_ok=True)
    assert widths_of_most_changed({"recorded": made["recorded"]}) == {}
