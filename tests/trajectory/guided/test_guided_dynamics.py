"""A piece of flight: errors between their times, the true direction of the thrust, and where a burn stops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.ascent.legs import STEP
from lvnav_trade.trajectory.guided import guided_dynamics
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.guided_dynamics import (
    PERFECT,
    Cutoff,
    NavigationErrors,
    error_at,
    fly_last,
    fly_piece,
    navigated_energy,
)
from lvnav_trade.trajectory.guided.pilots import GuidedPilot
from tests.trajectory.guided.cases import constant_error, plan


@pytest.fixture
def inputs():
    known = plan("two_stage_leo", "open_loop")
    return GuidedPilot(known, known.card, deviations(known.card, {}), PERFECT).inputs


def test_an_error_stays_to_the_next_time_and_the_position_drifts_with_the_velocity_error():
    error = np.array([np.arange(9.0), np.arange(9.0) + 2.0])
    navigation = NavigationErrors(np.array([10.0, 20.0]), error)
    np.testing.assert_allclose(error_at(0.0, navigation), error[0])
    for t, k, span in ((15.0, 0, 5.0), (20.0, 1, 0.0), (25.0, 1, 5.0)):
        wanted = error[k].copy()
        wanted[6:] += span * error[k, 3:6]
        np.testing.assert_allclose(error_at(t, navigation), wanted)


def test_the_thrust_is_turned_by_the_attitude_error_and_by_misalignments(inputs):
    r = (6.5e6, 0.0, 1e5)
    u = np.array(guided_dynamics.commanded_direction(300.0, inputs))
    tilt = np.array([1e-4, -2e-4, 3e-4])
    turned = guided_dynamics.thrust_direction(300.0, r, inputs._replace(navigation=constant_error(attitude=tilt)))
    np.testing.assert_allclose(np.array(turned) - u, np.cross(tilt, u), atol=1e-7)
    aside = guided_dynamics.thrust_direction(300.0, r, inputs._replace(misalignment=np.array([0.0, 1e-3])))
    right = np.cross(u, r) / np.linalg.norm(np.cross(u, r))
    assert (np.array(aside) - u) @ right == pytest.approx(1e-3, rel=1e-5)
    down = guided_dynamics.thrust_direction(300.0, r, inputs._replace(misalignment=np.array([1e-3, 0.0])))
    assert (np.array(down) - u) @ np.array(r) < 0.0


def test_wind_is_the_motion_of_the_air_to_the_east_and_north(inputs):
    engine = Propulsion(0.0, 0.0, 0.0, 1.0)
    y = np.array([6378137.0 + 5e3, 0.0, 0.0, 0.0, 465.0, 0.0, 1e4])
    blown = inputs._replace(wind=guided_dynamics.Wind(500.0, np.tile([10.0, 20.0], (61, 1))))
    still = guided_dynamics.rates(0.0, y, engine, inputs) - guided_dynamics.rates(0.0, y, engine, blown)
    assert still[4] < 0.0 < -still[5]  # carried to the east (y) and to the north (z)
    assert still[5] / still[4] == pytest.approx(2.0, rel=0.1)
    high = y.copy()
    high[0] += 60e3
    np.testing.assert_array_equal(
        guided_dynamics.rates(0.0, high, engine, inputs), guided_dynamics.rates(0.0, high, engine, blown)
    )


@pytest.fixture
def burn():
    """State, and an engine of 68 kN, in the last burn."""
    known = plan("two_stage_leo", "open_loop")
    y = known.nominal.copy()
    y[6] = 6000.0
    return y, Propulsion(68e3, 68e3 / 3187.0, 0.0, math.inf)


def test_a_burn_without_another_end_stops_at_the_mass_of_the_empty_stage_by_the_rocket_equation(inputs, burn):
    y, engine = burn
    t, end, why = fly_last(300.0, 900.0, STEP, y, engine, inputs, Cutoff(False, 0.0, 1e9, 5000.0))
    assert why == guided_dynamics.EMPTY
    assert t - 300.0 == pytest.approx(1000.0 * 3187.0 / 68e3, abs=1e-9)
    assert end[6] == pytest.approx(5000.0, abs=1e-8)


def test_a_cut_off_by_energy_stops_within_a_step_where_the_navigated_energy_is_reached(inputs, burn):
    y, engine = burn
    for navigation in (PERFECT, constant_error(velocity=(1.0, 2.0, -1.0), position=(100.0, 0.0, 50.0))):
        here = inputs._replace(navigation=navigation)
        wanted = navigated_energy(300.0, y, navigation) + 1e5
        t, end, why = fly_last(300.0, 400.0, STEP, y, engine, here, Cutoff(True, wanted, 0.0, 0.0))
        assert why == guided_dynamics.CUT_OFF
        assert navigated_energy(t, end, navigation) == pytest.approx(wanted, abs=1e-3)
        fine = fly_piece(300.0, t, 0.01, y, engine, here)
        np.testing.assert_allclose(end, fine, rtol=1e-9, atol=1e-6)


def test_a_cut_off_by_time_and_a_piece_that_ends_before(inputs, burn):
    y, engine = burn
    t, _, why = fly_last(300.0, 400.0, STEP, y, engine, inputs, Cutoff(False, 0.0, 317.77, 0.0))
    assert (t, why) == (pytest.approx(317.77, abs=1e-9), guided_dynamics.CUT_OFF)
    t, _, why = fly_last(300.0, 310.0, STEP, y, engine, inputs, Cutoff(False, 0.0, 317.77, 0.0))
    assert (t, why) == (pytest.approx(310.0), guided_dynamics.WHOLE)
