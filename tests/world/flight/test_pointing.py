"""Laws of attitude point where they say, and a turn from one to the next is smooth and the shortest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.frames import earth_velocity, matrices, unit
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.world.flight import pointing
from lvnav_trade.world.flight.pointing import Mode, attitude, nose

T = np.linspace(0.0, 200.0, 801)


def circle():
    """States on a circle of 7000 km radius, inclined by 40 deg."""
    u, r, v = 1.1e-3 * T, 7e6, 7700.0
    towards, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, math.cos(0.7), math.sin(0.7)])
    position = r * (np.cos(u)[:, None] * towards + np.sin(u)[:, None] * across)
    return np.hstack([position, v * (np.cos(u)[:, None] * across - np.sin(u)[:, None] * towards)])


Y = circle()
FORWARD, BACKWARD = Mode(-math.inf, 0.0, pointing.along_velocity()), Mode(50.0, 60.0, pointing.along_velocity(-1.0))


def test_forward_and_backward_are_along_the_velocity_with_z_to_the_earth():
    for sign in (1.0, -1.0):
        C = pointing.along_velocity(sign)(T, Y)
        assert np.max(np.abs(C[:, :, 0] - sign * unit(Y[:, 3:6]))) < 1e-14
        assert np.max(np.abs(C[:, :, 2] + unit(Y[:, :3]))) < 1e-12


def test_level_is_across_the_radius_in_the_plane_of_the_orbit():
    climbing = Y.copy()
    climbing[:, 3:6] += 500.0 * unit(Y[:, :3])
    C = pointing.level(T, climbing)
    assert np.max(np.abs(C[:, :, 0] - unit(Y[:, 3:6]))) < 1e-12
    assert np.max(np.abs(C[:, :, 2] + unit(Y[:, :3]))) < 1e-12


def test_airspeed_is_the_velocity_in_air_that_turns_with_the_earth():
    C = pointing.along_airspeed(np.array([0.0, -math.sin(0.7), math.cos(0.7)]), 0.3)(T, Y)
    assert np.max(np.abs(C[:, :, 0] - unit(earth_velocity(Y[:, :3], Y[:, 3:6])))) < 1e-14


def test_what_is_fixed_to_the_earth_turns_with_it():
    C = pointing.fixed_to_earth(np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0]), 0.2)(T, Y)
    angle = np.arccos(np.clip(0.5 * (np.einsum("ij,kij->k", C[0], C) - 1.0), -1.0, 1.0))
    assert angle[-1] == pytest.approx(OMEGA * 200.0, rel=1e-6)


def test_pitch_lifts_the_nose_and_yaw_turns_it_to_the_right():
    C = pointing.along_velocity()(T, Y)
    up = pointing.turned(pointing.along_velocity(), math.radians(10.0), 0.0)(T, Y)
    right = pointing.turned(pointing.along_velocity(), 0.0, math.radians(10.0))(T, Y)
    assert np.max(np.abs(np.einsum("ki,ki->k", up[:, :, 0], -C[:, :, 2]) - math.sin(math.radians(10.0)))) < 1e-12
    assert np.max(np.abs(np.einsum("ki,ki->k", right[:, :, 0], C[:, :, 1]) - math.sin(math.radians(10.0)))) < 1e-12


def test_a_turn_begins_and_ends_with_the_laws_and_goes_about_one_axis():
    q = attitude([FORWARD, BACKWARD], T, Y)
    C, before, after = matrices(q), FORWARD.axes(T, Y), BACKWARD.axes(T, Y)
    assert np.max(np.abs(C[T <= 50.0] - before[T <= 50.0])) < 1e-14
    assert np.max(np.abs(C[T >= 110.0] - after[T >= 110.0])) < 1e-12
    # Half a circle about the body's z axis: z stays to the Earth, and the rate is that of the quintic, 1.875 * pi / 60.
    assert np.max(np.abs(C[:, :, 2] - before[:, :, 2])) < 1e-6
    step = np.einsum("kij,kij->k", C[1:, :, :1], C[:-1, :, :1])
    assert np.max(np.arccos(np.clip(step, -1.0, 1.0))) / 0.25 == pytest.approx(1.875 * math.pi / 60.0, rel=0.02)
    assert np.min(np.sum(q[1:] * q[:-1], axis=1)) > 0.99


def test_a_law_may_be_given_up_before_its_turn_is_done():
    held = pointing.fixed_to_stars(FORWARD.axes(T, Y)[300])
    q = attitude([FORWARD, BACKWARD, Mode(75.0, 20.0, held)], T, Y)
    assert np.max(np.abs(matrices(q)[T >= 95.0] - held(T, Y)[0])) < 1e-12
    assert np.min(np.sum(q[1:] * q[:-1], axis=1)) > 0.99


def test_the_nose_at_one_time_is_that_of_the_whole_history():
    held = pointing.fixed_to_stars(pointing.turned(pointing.level, 0.9, 0.4)(T[:1], Y[:1])[0])
    modes = [FORWARD, Mode(50.0, 60.0, held)]
    whole = matrices(attitude(modes, T, Y))[:, :, 0]
    for k in (0, 100, 230, 300, 700):
        assert np.max(np.abs(nose(modes, float(T[k]), Y[k]) - whole[k])) < 1e-12


def test_a_law_that_begins_after_the_end_changes_nothing():
    assert np.array_equal(attitude([FORWARD, Mode(900.0, 1.0, pointing.level)], T, Y), attitude([FORWARD], T, Y))
