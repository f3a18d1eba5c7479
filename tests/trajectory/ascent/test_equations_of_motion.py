"""Equations of motion against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.quantities.frames import ecef_from_geodetic
from lvnav_trade.trajectory.ascent.equations_of_motion import (
    NOTHING,
    Drag,
    Propulsion,
    UnthrottledMotors,
    engine_thrust,
    fly,
    height_above,
    rates,
    time_to_mass,
    unthrottled_thrust,
)
from tests.potential import potential_j4
from tests.trajectory.ascent.test_steering_law import steering

VACUUM = Drag(0.0, np.array([0.0, 1.0]), np.array([0.0, 0.0]))
ENGINE = Propulsion(1e6, 300.0, 1.0, 60.0)


def test_thrust_loses_ambient_pressure_times_exit_area():
    thrust, throttle = engine_thrust(1e5, 101325.0, ENGINE)
    assert thrust == pytest.approx(1e6 - 101325.0, rel=1e-6)
    assert throttle == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("mass", [1e4, 1.6e4, 1.7e4, 2e4])
def test_thrust_stays_below_the_load_limit(mass):
    thrust, throttle = engine_thrust(mass, 0.0, ENGINE)
    assert thrust <= 60.0 * mass
    assert throttle < 1.0


def test_an_engine_without_a_limit_is_not_throttled():
    assert engine_thrust(10.0, 0.0, ENGINE._replace(max_load=math.inf)) == (1e6, 1.0)


def test_the_limit_counts_the_thrust_of_other_motors():
    thrust, throttle = engine_thrust(3e4, 0.0, ENGINE, 1.2e6)
    assert thrust + 1.2e6 <= 60.0 * 3e4
    assert thrust == pytest.approx(6e5, rel=0.05)
    assert throttle == pytest.approx(thrust / 1e6)
    assert engine_thrust(1e4, 0.0, ENGINE, 1.2e6)[0] == 0.0  # nothing is left to throttle


def test_a_motor_of_straight_thrust_burns_what_its_flow_says():
    # Straight up, far from the Earth: mass falls with the integral of the flow, speed gains the log.
    motor = UnthrottledMotors(5.0, 9e5, -4e3, 300.0, -4.0 / 3.0, 0.5)
    y0 = np.array([1e9, 0.0, 0.0, 0.0, 0.0, 0.0, 1e5])
    still = steering(kick_angle=0.0, follow_start=np.inf, law_start=np.array([np.inf]))
    _, y = fly(5.0, 100.0, 400, y0, still, Propulsion(0.0, 0.0, 0.0, 1.0, motor), VACUUM)
    burnt = 300.0 * 100.0 - 0.5 * 4.0 / 3.0 * 100.0**2
    assert y[-1, 6] == pytest.approx(1e5 - burnt, rel=1e-12)
    assert np.linalg.norm(y[-1, 3:6]) == pytest.approx(3000.0 * math.log(1e5 / (1e5 - burnt)), abs=0.1)


def test_motors_that_cannot_be_throttled_lose_pressure_times_exit_area_and_never_pull():
    motor = UnthrottledMotors(0.0, 9e5, 0.0, 300.0, 0.0, 0.5)
    assert unthrottled_thrust(7.0, 101325.0, motor) == pytest.approx((9e5 - 0.5 * 101325.0, 300.0))
    assert unthrottled_thrust(7.0, 101325.0, motor._replace(thrust=1e4))[0] == 0.0
    assert unthrottled_thrust(7.0, 101325.0, NOTHING) == (0.0, 0.0)


def test_a_coast_keeps_its_energy():
    y0 = np.array([6.7e6, 0.0, 1e5, 10.0, 7600.0, 500.0, 1.0])
    _, y = fly(0.0, 600.0, 2400, y0, steering(), Propulsion(0.0, 0.0, 0.0, 1.0), VACUUM)
    energy = [0.5 * row[3:6] @ row[3:6] - potential_j4(*row[:3]) for row in y]
    assert np.ptp(energy) < 1e-10 * abs(energy[0])


def test_a_burn_gains_what_the_rocket_equation_says():
    # Straight up far from the Earth (gravitation 4e-4 m/s^2), where nothing turns.
    y0 = np.array([1e9, 0.0, 0.0, 0.0, 0.0, 0.0, 1e5])
    still = steering(kick_angle=0.0, follow_start=np.inf, law_start=np.array([np.inf]))
    _, y = fly(0.0, 100.0, 400, y0, still, ENGINE, VACUUM)
    assert y[-1, 6] == pytest.approx(7e4, rel=1e-9)
    speed = float(np.linalg.norm(y[-1, 3:6]))
    assert speed == pytest.approx(1e6 / 300.0 * math.log(1e5 / 7e4), abs=0.1)


def test_burn_time_to_a_mass_is_propellant_over_flow():
    y0 = np.array([1e9, 0.0, 0.0, 0.0, 0.0, 0.0, 1e5])
    assert time_to_mass(0.0, 7.1e4, 0.25, y0, steering(), ENGINE, VACUUM) == pytest.approx(2.9e4 / 300.0, abs=1e-6)


def test_drag_is_half_density_speed_squared_area_and_coefficient():
    r = ecef_from_geodetic(0.0, 0.0, 0.0)
    y = np.array([*r, 100.0, 7.292115e-5 * r[0], 0.0, 1000.0])
    drag = Drag(2.0, np.array([0.0, 1.0]), np.array([0.3, 0.3]))
    rate = rates(0.0, y, steering(), Propulsion(0.0, 0.0, 0.0, 1.0), drag)
    expected = 0.5 * 1.225 * 100.0**2 * 2.0 * 0.3 / 1000.0
    assert gravity_j4(*r)[0] - rate[3] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("height", [0.0, 1e5, 4e5])
def test_height_over_the_ellipsoid_is_within_a_fifth_of_a_percent_of_geodetic(height):
    r = ecef_from_geodetic(math.radians(-38.6), 1.0, height)
    assert height_above(*r) == pytest.approx(height, rel=2e-3, abs=1e-6)
