"""Frame changes against published points, and round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lvnav_trade.kernels.earth import GM, OMEGA
from lvnav_trade.quantities import frames

angle = st.floats(-np.pi, np.pi)
latitude = st.floats(-np.pi / 2, np.pi / 2)


def test_a_receiver_position_of_the_rtklib_tests_is_reproduced():
    # RTKLIB test/utest/t_coord.c; the position is quoted to 0.1 mm.
    lat, lon, height = frames.geodetic_from_ecef([-3517319.7701, 4131667.9161, 3341265.1227])
    assert np.degrees(lat) == pytest.approx(31.796021375, abs=3e-9)
    assert np.degrees(lon) == pytest.approx(130.40799917, abs=6e-9)
    assert height == pytest.approx(68.863206206, abs=3e-4)


def test_a_longitude_is_the_same_to_the_last_bit_wherever_in_memory_its_position_is():
    # numpy 2.0 chooses between two versions of arctan2 by where strided arguments are; 382 of 400 were equal
    draw = np.random.default_rng(3)
    r_e = 7e6 * draw.normal(size=(6001, 3))
    others, found = [], set()
    for _ in range(150):
        others += [np.ones(draw.integers(1, 40_000)) for _ in range(draw.integers(1, 8))]
        while len(others) > 30:
            del others[draw.integers(len(others))]
        found.add(frames.geodetic_from_ecef(r_e.copy())[1].tobytes())
    assert len(found) == 1


def test_a_geodetic_point_of_the_gnss_lib_tests_is_reproduced():
    r_e = frames.ecef_from_geodetic(np.radians(37.427112), np.radians(-122.1764146), 16.0)
    assert np.allclose(r_e, (-2700628.97971166, -4292443.61165747, 3855152.80233124), rtol=0.0, atol=1e-8)


def test_a_small_vector_turns_to_the_published_local_components():
    # RTKLIB: (0.3, 0.4, 0.5) at 35N 140E is east -0.499254, north 0.393916, up 0.309152.
    north, east, down = frames.rotation_e_n(np.radians(35.0), np.radians(140.0)) @ [0.3, 0.4, 0.5]
    assert (east, north, -down) == pytest.approx((-0.499254, 0.393916, 0.309152), abs=5e-7)


@given(latitude, angle, st.floats(-1e5, 4e7))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_geodetic_round_trip_returns_the_point(lat, lon, height):
    r_e = frames.ecef_from_geodetic(lat, lon, height)
    back = frames.ecef_from_geodetic(*frames.geodetic_from_ecef(r_e))
    assert np.allclose(back, r_e, rtol=0.0, atol=3e-8)  # a few ulps of 4e7 m
    assert frames.height_from_ecef(*r_e.tolist()) == pytest.approx(height, abs=3e-8)


def test_sidereal_time_is_that_of_vallado_example_3_5():
    # 1992-08-20 12:14 UT1: 152.578787810 deg, worked there from centuries rounded to 12 digits.
    assert np.degrees(frames.gmst("1992-08-20T12:14:00Z")) == pytest.approx(152.578787810, abs=1e-7)


def test_sidereal_time_knows_time_zones():
    assert frames.gmst("2024-06-01T09:00:00-03:00") == frames.gmst("2024-06-01T12:00:00Z")
    assert frames.gmst("2024-06-01T12:00:00") == frames.gmst("2024-06-01T12:00:00Z")


@given(angle, st.tuples(*[st.floats(-1e7, 1e7)] * 3))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_inertial_and_earth_fixed_components_are_inverse(theta, r):
    assert np.allclose(frames.eci_from_ecef(frames.ecef_from_eci(r, theta), theta), r, rtol=0.0, atol=1e-8)


def test_a_point_fixed_to_the_earth_has_no_velocity_relative_to_it():
    t = np.array([0.0, 100.0, 5000.0])
    theta = frames.earth_angle(1.0, t)
    r_i = frames.eci_from_ecef(np.broadcast_to([5e6, 1e6, 3e6], (3, 3)), theta)
    v_i = np.cross([0.0, 0.0, OMEGA], r_i)
    assert np.max(np.abs(frames.earth_velocity(r_i, v_i))) < 1e-12


def test_down_is_the_inward_normal_in_inertial_axes():
    theta = 0.7
    r_i = frames.eci_from_ecef(frames.ecef_from_geodetic(0.5, -1.0, 1e4), theta)
    higher = frames.eci_from_ecef(frames.ecef_from_geodetic(0.5, -1.0, 1.1e4), theta)
    assert np.allclose(frames.rotation_i_n(r_i, theta) @ (higher - r_i), (0.0, 0.0, -1000.0), rtol=0.0, atol=1e-6)


@given(
    st.floats(6.5e6, 4.2e7),
    st.floats(0.001, 0.9),
    st.floats(0.001, 3.14),
    st.tuples(*[st.floats(0.0, 6.28)] * 3),
)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_elements_and_state_are_inverse(a, e, inclination, angles):
    elements = frames.Elements(*(np.array(value) for value in (a, e, inclination, *angles)))
    r_i, v_i = frames.state_from_elements(elements)
    again = frames.state_from_elements(frames.elements_from_state(r_i, v_i))
    scale = np.linalg.norm(r_i)
    assert np.allclose(again[0], r_i, rtol=0.0, atol=1e-8 * scale)
    assert np.allclose(again[1], v_i, rtol=0.0, atol=1e-8 * np.linalg.norm(v_i))


def test_a_circular_equatorial_state_has_finite_elements():
    speed = np.sqrt(GM / 7e6)
    elements = frames.elements_from_state([7e6, 0.0, 0.0], [0.0, speed, 0.0])
    assert all(np.isfinite(value) for value in elements)
    r_i, v_i = frames.state_from_elements(elements)
    assert np.allclose(r_i, (7e6, 0.0, 0.0), rtol=0.0, atol=1e-3)
    assert np.allclose(v_i, (0.0, speed, 0.0), rtol=0.0, atol=1e-6)


def test_orbital_axes_are_radial_along_and_cross():
    r_i, v_i = np.array([7e6, 0.0, 0.0]), np.array([10.0, 0.0, 7500.0])
    C_i_o = frames.rotation_i_o(r_i, v_i)
    assert np.allclose(C_i_o @ r_i, (7e6, 0.0, 0.0))
    assert np.allclose(C_i_o @ v_i, (10.0, 7500.0, 0.0))
    assert np.linalg.det(C_i_o) == pytest.approx(1.0)


def test_quaternions_return_their_matrices_through_every_branch_with_a_continuous_sign():
    turn = np.linspace(0.0, 4.0 * np.pi, 400)
    axis = frames.unit(np.stack([np.cos(0.3 * turn), np.sin(0.7 * turn), 0.4 * np.ones_like(turn)], axis=-1))
    q = np.concatenate([np.cos(turn / 2)[:, None], np.sin(turn / 2)[:, None] * axis], axis=1)
    again = frames.quaternions(frames.matrices(q))
    assert np.allclose(again, np.sign(again[0] @ q[0]) * q, rtol=0.0, atol=1e-14)


def test_pad_axes_are_the_growth_of_azimuth_range_and_elevation():
    """Against differences of the three numbers themselves, as a station at the pad reckons them."""
    pad, rng = frames.ecef_from_geodetic(-0.67, -1.08, 20.0), np.random.default_rng(3)
    C = frames.rotation_e_n(-0.67, -1.08)

    def reckoned(r_e):
        north, east, down = C @ (r_e - pad)
        slant = np.linalg.norm(r_e - pad)
        return np.array([np.arctan2(east, north), slant, np.arcsin(-down / slant)])

    for _ in range(5):
        r_e = pad + C.T @ (1e5 * rng.normal(size=3))
        axes = frames.rotation_e_pad(r_e[None], pad)[0]
        _, slant, elevation = reckoned(r_e)
        scale = np.array([slant * np.cos(elevation), 1.0, slant])
        slope = np.stack([(reckoned(r_e + step) - reckoned(r_e - step)) / 0.2 for step in 0.1 * np.eye(3)], axis=1)
        np.testing.assert_allclose(scale[:, None] * slope, axes, atol=1e-6)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)


def test_on_the_pad_and_straight_above_it_the_range_is_up_and_azimuth_grows_to_the_east():
    pad = frames.ecef_from_geodetic(0.5, 0.2, 0.0)
    north, east, down = frames.rotation_e_n(0.5, 0.2)
    for height in (0.0, 500.0):
        axes = frames.rotation_e_pad((pad - height * down)[None], pad)[0]
        np.testing.assert_allclose(axes, [east, -down, -north], atol=1e-9)
