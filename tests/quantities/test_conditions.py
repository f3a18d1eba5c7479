"""Conditions on what is switched: when they hold on a flight with closed forms, how they combine, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.fault_cards import (
    ClockJump,
    DegradedNoise,
    FrozenOutput,
    GyroBiasStep,
    RangeBias,
    SatelliteOutage,
)
from lvnav_trade.gnss.faults import failures, periods, satellite_outages
from lvnav_trade.quantities.conditions import (
    Conditions,
    FlightProfile,
    SightConditions,
    intersection,
    is_inside,
    never_active_mistake,
)
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.simulation.preparation.imu import profiles_of
from lvnav_trade.trajectory.truth import motion
from tests.building import hop, loaded

INSTANTS = {"start": -10.0, "end": 190.0, "liftoff": 0.0, "cutoff": 60.0}


def thrown(t):
    """A stone thrown up at 400 m/s and 4 m/s^2: 20 km high after 100 s; before the throw it rests."""
    t = np.maximum(t, 0.0)
    return np.stack([400.0 * t - 2.0 * t**2, np.abs(400.0 - 4.0 * t) * (t > 0.0), 1e5 * np.exp(-t / 20.0)])


STONE = FlightProfile(INSTANTS, thrown)
T = np.arange(-10.0, 191.0)


def conditions(**stated):
    return Conditions.model_validate({k.rstrip("_"): v for k, v in stated.items()})


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({}, [(-math.inf, math.inf)]),
        ({"from_": "cutoff - 10 s", "until": "150 s"}, [(50.0, 150.0)]),
        # 400 t - 2 t^2 = 18 km at 100 -+ sqrt(1000) s
        ({"above": "18 km"}, [(100.0 - math.sqrt(1e3), 100.0 + math.sqrt(1e3))]),
        ({"below": "18 km"}, [(-math.inf, 100.0 - math.sqrt(1e3)), (100.0 + math.sqrt(1e3), math.inf)]),
        ({"above": "18 km", "until": "100 s"}, [(100.0 - math.sqrt(1e3), 100.0)]),
        ({"above": "10 km", "below": "18 km", "from_": "90 s"}, [(100 + math.sqrt(1e3), 100 + math.sqrt(5e3))]),
        ({"speed_below": "100 m/s"}, [(-math.inf, 0.0), (75.0, 125.0)]),
        ({"speed_above": "300 m/s"}, [(0.0, 25.0), (175.0, math.inf)]),
        ({"dynamic_pressure_below": "20 kPa"}, [(20.0 * math.log(5.0), math.inf)]),
        ({"dynamic_pressure_above": "20 kPa", "speed_above": "380 m/s"}, [(0.0, 5.0)]),
    ],
)
def test_conditions_hold_when_the_closed_form_says_and_all_at_once(stated, expected):
    found = STONE.active_intervals(conditions(**stated))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_below_and_above_a_level_share_the_flight_without_overlap_or_gap():
    low, high = (is_inside(STONE.active_intervals(conditions(**{name: "13.3 km"})), T) for name in ("below", "above"))
    np.testing.assert_array_equal(low, ~high)
    assert high.any()
    assert low.any()


def test_a_real_flight_crosses_the_level_at_the_edge():
    flight = hop()
    level = float(np.mean(flight.flight_profile.values[0][[0, -1]]))
    ((edge, end),) = flight.flight_profile.active_intervals(conditions(below=f"{level!r} m"))
    at = motion(flight, [edge])
    height = geodetic_from_ecef(ecef_from_eci(at.r_i, earth_angle(flight.theta0, edge)))[2][0]
    assert height == pytest.approx(level, abs=1e-4)  # m
    assert (flight.start < edge < flight.end, end) == (True, math.inf)


def test_intervals_are_cut_and_rounding_is_forgiven():
    assert intersection(((0.0, 3.0), (5.0, 9.0)), ((2.0, 6.0), (8.0, 20.0))) == ((2.0, 3.0), (5.0, 6.0), (8.0, 9.0))
    assert intersection(((0.0, 3.0),), ((3.0, 6.0),)) == ()
    t = np.array([1.0, 1.0 - 1e-9, 3.0 - 1e-9, 3.0, 2.0])
    assert is_inside(((1.0, 3.0),), t).tolist() == [True, True, False, False, True]


@pytest.mark.parametrize(
    ("stated", "reported"),
    [
        ({"above": "18 km", "below": "17 km"}, "above: should be less than below"),
        ({"speed_above": "3 m/s", "speed_below": "3 m/s"}, "speed_above: should be less"),
        ({"dynamic_pressure_above": "3 kPa", "dynamic_pressure_below": "300 Pa"}, "dynamic_pressure_above: should"),
        ({"dynamic_pressure_below": "0 Pa"}, "greater than 0"),
        ({"speed_below": "-1 m/s"}, "greater than or equal to 0"),
        ({"above": "18 kg"}, "wrong unit"),
        ({"elevation_above": "5 deg"}, "Extra inputs"),
    ],
)
def test_conditions_that_cannot_hold_are_refused(stated, reported):
    with pytest.raises(ValidationError, match=reported):
        conditions(**stated)


def test_elevations_are_between_the_nadir_and_the_zenith():
    card = SightConditions(elevation_above="5 deg", elevation_below="80 deg")
    assert card.meets_elevation(np.radians([-3.0, 5.1, 79.0, 81.0])).tolist() == [False, True, True, False]
    assert card.elevation_keys == ("elevation_above", "elevation_below") == card.condition_keys
    assert SightConditions().meets_elevation(np.radians([-90.0, 90.0])).all()
    with pytest.raises(ValidationError, match="between -90 deg and 90 deg"):
        SightConditions(elevation_above="91 deg")
    with pytest.raises(ValidationError, match="elevation_above: should be less"):
        SightConditions(elevation_above="9 deg", elevation_below="3 deg")


@pytest.mark.parametrize(
    ("stated", "field", "reported"),
    [
        ({"above": "21 km"}, "above", "whose altitude is 0 to 20 km"),
        ({"speed_above": "401 m/s"}, "speed_above", "whose speed is 0 to 39"),
        ({"dynamic_pressure_above": "101 kPa"}, "dynamic_pressure_above", r"to 100 kPa"),
        ({"from_": "191 s"}, "from", r"the flight \(-10 s to 190 s\)"),
        ({"until": "-11 s"}, "until", r"the flight \(-10 s to 190 s\)"),
        ({"above": "18 km", "speed_above": "300 m/s"}, "above", "together with the other conditions"),
        ({"above": "18 km", "until": "cutoff"}, "above", "together with the other conditions"),
    ],
)
def test_conditions_that_hold_at_no_time_of_the_flight_are_named(stated, field, reported):
    found = never_active_mistake(conditions(**stated), STONE)
    assert found.path == field
    with pytest.raises(ValueError, match=reported):
        raise ValueError(found.message)


def test_conditions_that_hold_are_no_mistake_and_an_unknown_event_is_one():
    assert never_active_mistake(conditions(above="19 km", speed_below="100 m/s"), STONE) is None
    with pytest.raises(InputError, match="no event 'cutof'") as caught:
        never_active_mistake(conditions(until="cutof"), STONE)
    assert caught.value.records[0].path == "until"


# --- faults -----------------------------------------------------------------------------------------------------------


def test_a_fault_holds_by_start_and_duration_by_conditions_or_by_both():
    assert periods(0, FrozenOutput(start="cutoff", duration="5 s"), STONE) == ((60.0, 65.0),)
    by_time = FrozenOutput.model_validate({"from": "cutoff", "until": "65 s"})
    assert periods(0, by_time, STONE) == ((60.0, 65.0),)
    found = periods(0, FrozenOutput(start="0 s", duration="150 s", above="18 km"), STONE)
    np.testing.assert_allclose(found, [(100 - math.sqrt(1e3), 100 + math.sqrt(1e3))], atol=1e-6)


@pytest.mark.parametrize(
    ("stated", "reported"),
    [
        ({}, "start: is missing, or a condition"),
        ({"duration": "3 s"}, "duration: counts from a start.* give until"),
        ({"start": "3 s"}, "duration: is missing: add it, or give from in place of start"),
        ({"duration": "3 s", "above": "3 km"}, "duration: counts from a start"),
    ],
)
def test_a_fault_without_a_time_is_refused(stated, reported):
    with pytest.raises(ValidationError, match=reported):
        FrozenOutput(**stated)


def test_a_clock_jumps_once_when_its_conditions_begin_to_hold():
    ((start, end),) = periods(0, ClockJump(speed_above="300 m/s", size="1 m"), STONE)
    assert (start, end) == (pytest.approx(0.0, abs=1e-6), start)
    assert periods(0, ClockJump(below="30 km", size="1 m"), STONE) == ((-10.0, -10.0),)
    for stated in ({}, {"start": "3 s", "above": "3 km"}):
        with pytest.raises(ValidationError, match="start: "):
            ClockJump(size="1 m", **stated)


def test_an_outage_by_altitude_takes_its_epochs_and_by_elevation_its_satellites():
    elevation = np.stack([np.radians(5.0) + 0.0 * T, np.radians(40.0) + 0.0 * T], axis=1)
    seen = np.ones((T.size, 2), dtype=bool)
    gone = satellite_outages([SatelliteOutage(below="18 km", elevation_below="10 deg")], STONE, T, elevation, seen)
    np.testing.assert_array_equal(gone[:, 0], thrown(T)[0] < 18e3)
    assert not gone[:, 1].any()
    with pytest.raises(InputError, match=r"faults\.0\.elevation_above: holds for no satellite"):
        satellite_outages([SatelliteOutage(above="1 km", elevation_above="50 deg")], STONE, T, elevation, seen)


def test_low_satellites_are_noisy_and_drift_from_when_the_condition_begins():
    elevation = np.stack([np.radians(5.0) + 0.0 * T, np.radians(40.0) + 0.0 * T], axis=1)
    names, seen = ("G01", "G02"), np.ones((T.size, 2), dtype=bool)
    noisy = DegradedNoise(elevation_below="10 deg", factor=3.0)
    drifting = RangeBias(speed_above="300 m/s", satellites=["G02"], drift="2 m/s")
    out = failures([noisy, drifting], STONE, T, names, elevation, seen)
    assert np.unique(out.noise[:, 0]).tolist() == [3.0]
    assert np.unique(out.noise[:, 1]).tolist() == [1.0]
    assert np.unique(out.solution_noise).tolist() == [1.0]
    at = {t: out.bias[T == t, 1].item() for t in (10.0, 24.0, 60.0, 185.0)}
    assert at == {10.0: pytest.approx(20.0, abs=1e-5), 24.0: pytest.approx(48.0, abs=1e-5), 60.0: 0.0,
                  185.0: pytest.approx(20.0, abs=1e-5)}  # fmt: skip


def test_a_bias_step_by_speed_is_that_of_the_same_times():
    size = ["20 deg/h", "0 deg/h", "0 deg/h"]
    by_time = GyroBiasStep(start="75 s", duration="50 s", size=size)
    by_speed = GyroBiasStep.model_validate({"speed_below": "100 m/s", "from": "1 s", "size": size})
    steps = [profiles_of(loaded().imu, [fault], STONE) for fault in (by_time, by_speed)]
    np.testing.assert_allclose([p[2] for p in steps[1]], [p[2] for p in steps[0]], atol=1e-6)
    assert [p[4] for p in steps[1]] == [p[4] for p in steps[0]]
    always = profiles_of(loaded().imu, [GyroBiasStep(below="30 km", size=size)], STONE)
    assert [(p[3], p[4][0] > 0.0) for p in always] == [(-10.0, True)]  # full at the first tick, and it does not end
