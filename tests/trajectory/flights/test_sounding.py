"""Sounding rockets: what their card refuses, and a flight like its class."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef, matrices, unit
from lvnav_trade.trajectory.ascent.legs import site_axes
from lvnav_trade.trajectory.flights.sounding import SoundingFlight, launch
from lvnav_trade.trajectory.truth import motion, reference
from tests.trajectory.flight_cases import sounding, sounding_settings
from tests.trajectory.test_truth import strapdown


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mach": [0.0, 1.0]}, "2 Mach numbers but 7 drag coefficients"),
        ({"mach": [0.0, 0.8, 0.8, 1.5, 3.0, 5.0, 10.0]}, "mach must rise"),
        ({"apogee": None, "rail": {"azimuth": "0 deg", "length": "9 m"}}, "give the rail's elevation or the apogee"),
        ({"turn_time": "30 s"}, "stage 'S-44M' is turned within turn_time, longer than its ignition_delay"),
    ],
)
def test_a_card_that_cannot_be_meant_is_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        SoundingFlight.model_validate(sounding_settings(**change))


@pytest.mark.parametrize(
    ("stage", "change", "message"),
    [
        (0, {"elevation": "80 deg"}, "the first stage starts from the rail"),
        (0, {"separation_delay": None}, "stage 'S-40TM' stays, but another burns above it"),
        (0, {"ignition_delay": "3 s"}, "of the first stage has no effect: it ignites at lift-off"),
        (1, {"elevation": "20 deg"}, "nothing is left for the apogee"),
    ],
)
def test_a_stage_that_does_not_fit_the_others_is_refused(stage, change, message):
    settings = sounding_settings()
    stages = [dict(one) for one in settings["stages"]]
    stages[stage] |= change
    with pytest.raises(ValidationError, match=message):
        SoundingFlight.model_validate(settings | {"stages": stages})


def fly(**changes):
    settings = copy.deepcopy(sounding_settings())
    for name, value in changes.items():
        *way, last = name.split("__")
        at = settings
        for key in way:
            at = at[int(key) if isinstance(at, list) else key]
        at[last] = value
    return launch(SoundingFlight.model_validate(settings))


def heights(flight, t):
    return geodetic_from_ecef(ecef_from_eci(motion(flight, t).r_i, earth_angle(flight.theta0, t)))[2]


def test_the_apogee_is_the_published_one():
    flight = sounding()
    assert heights(flight, np.array([flight.events["apogee"]]))[0] == pytest.approx(180e3, abs=1.0)
    assert flight.facts["apogee_m"] == pytest.approx(180e3, abs=1.0)


def test_the_experiment_in_the_atmosphere_lasts_as_long_as_published(record_property):
    # DLR, 2012-06-28: 55 s from 100 to 20 km planned; the flight of 10 minutes goes on below.
    flight = sounding()
    t = np.arange(flight.events["apogee"], flight.end, 0.05)
    entry = float(np.interp(-100e3, -heights(flight, t), t))
    record_property("from 100 to 20 km", f"{flight.end - entry:.0f} s, published 55 s")
    assert heights(flight, np.array([flight.end]))[0] == pytest.approx(20.5e3, abs=1.5e3)
    assert flight.end - entry == pytest.approx(55.0, abs=5.0)
    latitude = geodetic_from_ecef(ecef_from_eci(motion(flight, [flight.end]).r_i, flight.theta0))[0]
    assert 76.5 < math.degrees(latitude[0]) < 80.1  # the latitudes of Spitsbergen


def test_the_same_motors_reach_the_published_apogee_of_their_own_rocket(record_property):
    # VS-40: 650 km with 500 kg of payload, straight gravity turn; the elevation is not published, launchers have 80-89.
    rail = {"azimuth": "348 deg", "length": "10 m"}
    flight = fly(payload="500 kg", apogee="650 km", end_altitude="100 km", rail=rail, spin=[])
    elevation = math.degrees(flight.facts["rail_elevation_rad"])
    record_property("VS-40 to 650 km", f"rail at {elevation:.1f} deg")
    assert flight.facts["apogee_m"] == pytest.approx(650e3, abs=10.0)
    assert 80.0 < elevation < 89.0


def test_events_come_in_their_order_and_the_end_is_a_whole_second():
    events = sounding().events
    expected = ["liftoff", "rail_exit", "max_q", "stage1_cutoff", "stage1_separation", "stage2_ignition",
                "stage2_cutoff", "stage2_separation", "apogee", "end"]  # fmt: skip
    assert list(events) == expected
    assert list(events.values()) == sorted(events.values())
    assert events["stage1_cutoff"] == pytest.approx(60.0)
    assert events["stage2_cutoff"] - events["stage2_ignition"] == pytest.approx(66.0)
    assert events["end"] == sounding().end == round(events["end"])


def test_on_the_rail_it_moves_along_the_rail_and_points_along_it():
    flight = sounding()
    t = np.linspace(0.0, flight.events["rail_exit"] - 1e-6, 50)
    m = motion(flight, t)
    r_e = ecef_from_eci(m.r_i, earth_angle(flight.theta0, t))
    card = SoundingFlight.model_validate(sounding_settings())
    up, downrange, _ = site_axes(card.site, card.rail.azimuth)
    rail = math.cos(card.rail.elevation) * downrange + math.sin(card.rail.elevation) * up
    way = r_e - r_e[0]
    assert np.max(np.abs(way - np.outer(way @ rail, rail))) < 1e-6
    assert way[-1] @ rail == pytest.approx(10.0, abs=1e-4)
    nose = ecef_from_eci(matrices(m.q_b_i)[:, :, 0], earth_angle(flight.theta0, t))
    assert np.min(nose @ rail) > math.cos(1e-4)


def test_it_flies_nose_first_through_the_air_and_thrust_is_along_the_nose():
    flight = sounding()
    m = motion(flight, [30.0, flight.events["max_q"], 55.0])
    x = matrices(m.q_b_i)[:, :, 0]
    assert np.min(np.sum(x * unit(earth_velocity(m.r_i, m.v_i)), axis=1)) > math.cos(1e-5)
    felt = motion(flight, np.linspace(flight.events["stage2_ignition"] + 5.0, flight.events["stage2_cutoff"] - 5.0, 40))
    # Drag is not along the nose once the attitude is kept: at 53 km it is still some thousandths of the thrust.
    assert np.max(np.abs(felt.f_b[:, 1:])) < 0.01 * np.min(felt.f_b[:, 0])


def test_above_the_air_the_spinning_body_keeps_its_axis_and_its_increments_are_those_of_the_spin():
    flight = sounding()
    ref = reference(flight, 400.0)
    first, last = np.searchsorted(ref.t, [flight.events["stage2_cutoff"] + 1.0, flight.events["stage2_separation"]])
    turn = ref.dtheta[first:last]
    assert np.max(np.abs(turn[:, 0] - 2.0 * math.pi * 1.7 / 400.0)) < 1e-12
    assert np.max(np.abs(turn[:, 1:])) < 1e-12
    x = matrices(ref.q_b_i[first:last])[:, :, 0]
    assert np.max(np.abs(x - x[0])) < 1e-9


def test_no_yo_yo_no_spin_on_the_pad_and_after_it():
    flight = sounding()
    stopped = flight.events["stage2_separation"] + 7.5
    m = motion(flight, [-30.0, 40.0, stopped])
    assert np.abs(m.w_ib_b[[0, 2], 0]) == pytest.approx([0.0, 0.0], abs=1e-4)
    assert m.w_ib_b[1, 0] == pytest.approx(2.0 * math.pi * 1.7, rel=1e-3)


def test_a_perfect_strapdown_returns_the_spinning_flight():
    # Trapezoidal position is of second order: 0.3 m at 400 Hz, a sixteenth of it at 1600 Hz.
    position, velocity = strapdown(reference(sounding(), 400.0))
    assert position < 0.5
    assert velocity < 2e-3


def test_position_and_velocity_are_continuous_where_phases_meet():
    flight = sounding()
    for before, after in zip(flight.phases, flight.phases[1:], strict=False):
        assert before.end == after.start
        assert np.max(np.abs(before.position(before.end) - after.position(after.start))) < 1e-6
        assert np.max(np.abs(before.position(before.end, 1) - after.position(after.start, 1))) < 1e-6


def test_a_rocket_without_a_turn_of_its_last_stage_flies_on_as_it_points():
    flight = fly(apogee=None, end_altitude="100 km", spin=[])
    m = motion(flight, [flight.events["stage2_ignition"] + 60.0])
    assert flight.facts["apogee_m"] > 100e3
    assert np.linalg.norm(m.w_ib_b) < 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"apogee": "900 km"}, "an apogee of 900 km is out of reach with elevations of -10 to 80 deg"),
        ({"end_altitude": "200 km"}, "the apogee is not above end_altitude"),
        ({"payload": "30 t"}, "the thrust of 'S-40TM' does not lift the rocket off its rail"),
        ({"apogee": None, "rail__elevation": "20 deg"}, "past its apogee before its last stage is done"),
    ],
)
def test_what_cannot_be_flown_is_reported_in_one_line(change, message):
    with pytest.raises(InputError, match=message):
        fly(**change)
