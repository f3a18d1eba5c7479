"""The recovery from orbit keeps the published times, speeds and places; orbits precess as they must."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.kernels.earth import GM, J2, SEMI_MAJOR
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    elements_from_state,
    geodetic_from_ecef,
    matrices,
    unit,
)
from lvnav_trade.quantities.reads import FieldReads
from lvnav_trade.trajectory.flights.orbital import OrbitalFlight, orbit
from lvnav_trade.trajectory.truth import Trajectory, motion, reference
from tests.potential import potential_j4
from tests.trajectory.flight_cases import orbital_settings, recovery
from tests.trajectory.test_truth import strapdown

ORBIT = {
    "perigee": "500 km",
    "apogee": "520 km",
    "inclination": "60 deg",
    "node": "10 deg",
    "perigee_argument": "30 deg",
}


def fly(legs, **changes) -> Trajectory:
    card = {"name": "test", "source": "assumed", "epoch": "2024-03-20T12:00:00Z", "orbit": ORBIT, "mass": "500 kg",
            "legs": legs}  # fmt: skip
    return orbit(OrbitalFlight.model_validate(card | changes))


def place(flight, t):
    """Latitude and longitude (deg), height (m), ground speed (m/s) at a time."""
    m = motion(flight, [t])
    latitude, longitude, height = geodetic_from_ecef(ecef_from_eci(m.r_i, earth_angle(flight.theta0, t)))
    speed = float(np.linalg.norm(earth_velocity(m.r_i, m.v_i)))
    return math.degrees(latitude[0]), math.degrees(longitude[0]), float(height[0]), speed


def test_entry_and_splash_down_come_at_the_published_times(record_property):
    # De-boost from 09:00 IST, entry at 100 km at 09:37, splash-down at 09:47: whole minutes are published.
    events = recovery().events
    assert events["deboost_cutoff"] - events["deboost_ignition"] == 559.0
    for name, minutes in (("entry", 37.0), ("end", 47.0)):
        found = (events[name] - events["deboost_ignition"]) / 60.0
        record_property(f"recovery, {name}", f"{found:.1f} min, published {minutes:.0f} min")
        assert found == pytest.approx(minutes, abs=0.6)


def test_entry_speed_descent_speeds_and_splash_down_are_the_published_ones(record_property):
    # 8 km/s at 100 km, 101 m/s at 5 km, 47 m/s under the drogue, 12 m/s at splash-down 140 km east of Sriharikota.
    flight = recovery()
    events = flight.events
    for name, speed, band in (("entry", 8000.0, 100.0), ("drogue", 101.0, 3.0), ("main_parachute", 47.0, 2.0)):
        found = place(flight, events[name])[3]
        record_property(f"recovery, speed at {name}", f"{found:.1f} m/s, published {speed:.0f} m/s")
        assert found == pytest.approx(speed, abs=band)
    latitude, longitude, height, speed = place(flight, events["end"])
    assert speed == pytest.approx(12.0, abs=0.5)
    assert 0.0 <= height < 15.0
    assert (latitude, longitude) == pytest.approx((13.7, 81.5), abs=0.3)


def test_the_deboost_begins_over_the_pacific_off_the_coast_of_mexico_and_goes_over_the_pole():
    flight = recovery()
    latitude, longitude, height, _ = place(flight, flight.events["deboost_ignition"])
    assert 5.0 < latitude < 25.0
    assert -115.0 < longitude < -85.0
    assert 485e3 < height < 660e3
    latitudes = [place(flight, t)[0] for t in np.arange(2000.0, 3000.0, 20.0)]
    assert max(latitudes) > 80.0


def test_the_body_turns_backward_brakes_and_meets_the_air_nose_first():
    flight = recovery()
    events = flight.events
    x = matrices(motion(flight, [100.0, 1500.0, events["entry"]]).q_b_i)[:, :, 0]
    m = motion(flight, [100.0, 1500.0, events["entry"]])
    ways = [unit(m.v_i)[0], -unit(m.v_i)[1], unit(earth_velocity(m.r_i, m.v_i))[2]]
    assert np.min(np.sum(x * ways, axis=1)) > math.cos(1e-6)
    burn = motion(flight, np.linspace(events["deboost_ignition"] + 1.0, events["deboost_cutoff"] - 1.0, 30)).f_b
    assert np.max(np.abs(burn[:, 1:])) < 1e-5
    assert burn[0, 0] == pytest.approx(151.9 / 555.0, rel=2e-3)
    assert burn[-1, 0] == pytest.approx(151.9 / (555.0 - 558.0 * 151.9 / 220.0 / 9.80665), rel=2e-3)


def test_the_node_precesses_by_the_closed_form():
    # Secular rate of the node by J2: -3 pi J2 (a / p)^2 cos i in a revolution; J3 and J4 are a thousandth of it.
    period = 2.0 * math.pi * math.sqrt((SEMI_MAJOR + 510e3) ** 3 / GM)
    flight = fly([{"name": "coast", "duration": f"{period * 1.01} s", "attitude": "horizontal"}])
    t = np.linspace(0.0, flight.end, 6000)
    m = motion(flight, t)
    found = elements_from_state(m.r_i, m.v_i)
    u = np.unwrap(found.perigee_argument + found.true_anomaly)
    node = np.interp(u[0] + 2.0 * math.pi, u, np.unwrap(found.node))
    a, e = SEMI_MAJOR + 510e3, 10e3 / (SEMI_MAJOR + 510e3)
    expected = -3.0 * math.pi * J2 * (SEMI_MAJOR / a / (1.0 - e * e)) ** 2 * math.cos(math.radians(60.0))
    assert node - found.node[0] == pytest.approx(expected, rel=0.01)


def test_the_orbit_of_the_card_is_that_of_the_start():
    flight = fly([{"name": "coast", "duration": "60 s"}], orbit=ORBIT | {"latitude_argument": "75 deg"})
    m = motion(flight, [0.0])
    found = elements_from_state(m.r_i[0], m.v_i[0])
    a, e = float(found.semi_major_axis), float(found.eccentricity)
    assert a * (1.0 - e) - SEMI_MAJOR == pytest.approx(500e3, abs=1e-3)
    assert a * (1.0 + e) - SEMI_MAJOR == pytest.approx(520e3, abs=1e-3)
    assert math.degrees(float(found.inclination)) == pytest.approx(60.0, abs=1e-9)
    assert math.degrees(float(found.perigee_argument + found.true_anomaly)) % 360.0 == pytest.approx(75.0, abs=1e-6)
    assert math.degrees(float(found.node) - flight.theta0) % 360.0 == pytest.approx(10.0, abs=1e-9)


def test_energy_is_kept_and_nothing_is_felt_in_a_coast():
    flight = fly([{"name": "coast", "duration": "2000 s", "attitude": "prograde"}])
    m = motion(flight, np.linspace(0.0, 2000.0, 500))
    energy = 0.5 * np.sum(m.v_i**2, axis=1) - [potential_j4(*r) for r in m.r_i]
    assert np.ptp(energy) < 1e-9 * abs(energy[0])
    assert np.max(np.abs(m.f_b)) < 1e-6


def test_a_burn_gives_the_speed_of_the_rocket_equation_and_dv_is_the_integral_of_what_is_felt():
    flight = fly([{"name": "coast", "duration": "10 s", "attitude": "horizontal"},
                  {"name": "kick", "duration": "100 s", "thrust": "2 kN", "specific_impulse": "300 s"}])  # fmt: skip
    ref = reference(flight, 100.0)
    expected = 300.0 * 9.80665 * math.log(500.0 / (500.0 - 100.0 * 2000.0 / 300.0 / 9.80665))
    assert np.sum(ref.dvel[:, 0]) == pytest.approx(expected, rel=1e-6)
    assert list(flight.events) == ["coast", "kick_ignition", "kick_cutoff", "end"]


def test_an_inertial_attitude_is_kept_and_half_a_turn_is_smooth():
    flight = fly([{"name": "coast", "duration": "50 s", "attitude": "prograde"},
                  {"name": "turn", "duration": "150 s", "attitude": "retrograde", "slew": "100 s"},
                  {"name": "hold", "duration": "100 s"}])  # fmt: skip
    m = motion(flight, np.arange(0.0, 300.0, 0.1))
    assert np.max(np.abs(m.w_ib_b[m.t > 270.0])) < 1e-7
    assert np.max(np.linalg.norm(m.w_ib_b, axis=1)) < 1.1 * (1.875 * math.pi / 100.0 + 1.2e-3)
    assert np.max(np.abs(np.diff(m.w_ib_b, axis=0))) < 1e-3


def test_a_perfect_strapdown_returns_a_deboost():
    flight = recovery()
    part = [p for p in flight.phases if p.name in ("turn", "deboost")]
    position, velocity = strapdown(reference(Trajectory(tuple(part), {}, flight.theta0, ""), 50.0))
    assert position < 0.01
    assert velocity < 1e-4


def test_a_leg_cuts_no_corner_where_the_air_begins():
    # Without air the same way down has the same times but for what drag takes: here, above 200 km, nothing.
    flight = fly([{"name": "coast", "duration": "10 s", "attitude": "prograde"}], reference_area="1 m^2",
                 orbit=ORBIT | {"perigee": "0 km", "apogee": "250 km", "latitude_argument": "150 deg"},
                 descent={"altitude": "90 km", "slew": "30 s"})  # fmt: skip
    assert flight.events["entry"] < flight.end
    assert place(flight, flight.events["entry"])[2] == pytest.approx(100e3, abs=1.0)
    assert 90e3 <= place(flight, flight.end)[2] < 92e3


@pytest.mark.parametrize(("area", "is_read"), [("1 m^2", True), ("0 m^2", False)])
def test_the_drag_table_has_an_effect_with_a_reference_area_alone(area, is_read):
    card = OrbitalFlight.model_validate(
        orbital_settings(reference_area=area, legs=[{"name": "coast", "duration": "10 s"}], descent=None, assumed={})
    )
    reads = FieldReads(card)
    orbit(reads.card)
    assert {"mach" in reads.paths, "drag_coefficient" in reads.paths} == {is_read}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": "10 kg"}, "the burns use"),
        ({"orbit": {**ORBIT, "apogee": "400 km"}}, "apogee lies below perigee"),
        ({"mach": [0.0, 1.0, 2.0]}, "3 Mach numbers but 5 drag coefficients"),
        ({"mach": [0.0, 1.0, 1.0, 2.0, 3.0]}, "mach must rise"),
        ({"legs": [{"name": "a", "duration": "9 s"}] * 2}, "two legs have the same name"),
        ({"legs": [{"name": "a", "duration": "9 s", "slew": "9 s"}]}, "slew of the first leg has no effect"),
        ({"orbit": {"perigee": "-6800 km", "apogee": "90 km", "inclination": "9 deg"}}, "is below the Earth's centre"),
        ({"legs": [{"name": "a", "duration": "9 s", "thrust": "1 N"}]}, "a burn needs thrust and specific_impulse"),
        ({"descent": {"altitude": "3 km", "parachutes": [{"name": "a", "below": "2 km", "drag_area": "1 m^2"}]}},
         "parachutes open one below the other"),
    ],
)  # fmt: skip
def test_a_card_that_cannot_be_meant_is_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        OrbitalFlight.model_validate(copy.deepcopy(orbital_settings()) | change)


def test_what_cannot_be_flown_is_reported_in_one_line():
    coast, low = {"name": "coast", "duration": "10 s"}, ORBIT | {"perigee": "-900 km", "apogee": "120 km"}
    with pytest.raises(InputError, match="does not come down to 50 km"):
        fly([coast], descent={"altitude": "50 km"})
    with pytest.raises(InputError, match="the descent begins below 300 km"):
        fly([coast], orbit=low | {"latitude_argument": "210 deg"}, descent={"altitude": "300 km"})
    with pytest.raises(InputError, match="the leg 'long' ends on the ground"):
        fly([{"name": "long", "duration": "4000 s"}], orbit=low | {"latitude_argument": "210 deg"})
    burn = {"name": "brake", "duration": "10 s", "thrust": "1 N", "specific_impulse": "200 s", "attitude": "retrograde"}
    with pytest.raises(InputError, match="the body would turn by 180 deg while 'brake' burns"):
        fly([coast | {"attitude": "prograde"}, burn])
