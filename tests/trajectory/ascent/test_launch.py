"""The two-stage ascent looks like that of Canepa and Servidia."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.frames import earth_velocity, matrices, unit
from lvnav_trade.trajectory.ascent.launch import pad_knots
from lvnav_trade.trajectory.truth import motion
from tests.trajectory.flight_cases import ascent


def test_the_published_times_and_loads_come_out():
    # Canepa and Servidia: 60 s on the pad, up to 6 g, first cut-off before 180 s, injection about 9 min after lift-off.
    flight = ascent()
    assert flight.start == -60.0
    assert flight.events["stage1_cutoff"] < 180.0
    assert flight.events["injection"] == pytest.approx(540.0, abs=20.0)
    assert flight.end == pytest.approx(flight.events["injection"] + 20.0)
    assert 5.5 < flight.facts["max_load_g"] <= 6.0


def test_the_load_limit_holds_on_the_truth_itself():
    m = motion(ascent(), np.arange(0.0, ascent().end, 0.05))
    assert np.max(np.linalg.norm(m.f_b, axis=1)) <= 6.0 * 9.80665


def test_the_orbit_is_reached_within_1_km_and_a_hundredth_of_a_degree():
    facts = ascent().facts
    assert facts["perigee_m"] == pytest.approx(350e3, abs=1e3)
    assert facts["apogee_m"] == pytest.approx(350e3, abs=1e3)
    assert math.degrees(facts["inclination_rad"]) == pytest.approx(45.0, abs=0.01)


def test_greatest_dynamic_pressure_falls_where_launchers_have_it():
    assert 50.0 < ascent().events["max_q"] < 90.0
    assert 20e3 < ascent().facts["max_dynamic_pressure_pa"] < 60e3


def test_the_body_points_along_the_velocity_at_greatest_dynamic_pressure():
    m = motion(ascent(), [ascent().events["max_q"]])
    x = matrices(m.q_b_i)[0, :, 0]
    assert x @ unit(earth_velocity(m.r_i, m.v_i))[0] > math.cos(math.radians(0.01))


def test_thrust_is_along_the_roll_axis_in_vacuum():
    t = np.linspace(ascent().events["fairing_separation"] + 1.0, ascent().events["injection"] - 1.0, 200)
    f_b = motion(ascent(), t).f_b
    assert np.max(np.abs(f_b[:, 1:])) < 1e-5 * np.max(f_b[:, 0])


def test_the_body_never_turns_faster_than_its_roll_rate():
    m = motion(ascent(), np.arange(0.0, ascent().end, 0.05))
    assert np.degrees(np.max(np.linalg.norm(m.w_ib_b, axis=1))) < 6.1


def test_pad_knots_end_before_lift_off():
    knots = pad_knots(60.0, 0.25)
    assert knots[0] == -60.0
    assert -0.3 < knots[-1] < 0.0
    assert pad_knots(0.0, 0.25).size == 0
