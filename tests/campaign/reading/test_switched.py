"""Conditions of sensors and faults that hold at no time of the flight, or have no effect, are input errors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading import flights, switched
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from tests.building import SITE_R, hop
from tests.standing import pad

EVENTS = {"liftoff": 0.0, "stage1_cutoff": 150.0, "injection": 540.0}  # the climb holds 60 s and coasts 20 s
LISTED = "filter.measurements=[pseudorange, range_rate, altitude]"
UNABLE = switched._capability_errors
SOLUTION = "filter.measurements=[position, velocity]"


@pytest.fixture(autouse=True)
def climbing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The small study's vehicle does not reach its orbit; here it climbs at 400 m/s and gains 10 m/s each second."""
    instants = {"start": -60.0, "end": 560.0, **EVENTS}
    course = FlightProfile(instants, lambda t: np.maximum(t, 0.0) * np.array([[400.0], [10.0], [1.0]]))
    monkeypatch.setattr(switched, "trajectory_of", lambda _: SimpleNamespace(flight_profile=course))
    monkeypatch.setattr(switched, "_capability_errors", lambda *_: iter(()))  # it needs a whole trajectory: `flying`


@pytest.fixture
def flying(monkeypatch: pytest.MonkeyPatch):
    """Let sensors be seen beside a trajectory."""

    def fly(trajectory) -> None:
        monkeypatch.setattr(switched, "trajectory_of", lambda _: trajectory)
        monkeypatch.setattr(switched, "_capability_errors", UNABLE)

    return fly


def reported(*sets: str) -> list[str]:
    campaign = load("campaign.yaml", sets)
    found = cases(campaign)
    return [str(one) for one in flights.mistakes(campaign, found, {case.id: EVENTS for case in found})]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("from=stage7_cutoff", "from: 'stage7_cutoff': no event 'stage7_cutoff' (did you mean 'stage1_cutoff'?)"),
        ("from=600 s", "from: holds at no time of the flight (-60 s to 560 s)"),
        ("until=-70 s", "until: holds at no time of the flight (-60 s to 560 s)"),
        ("from=stage1_cutoff", ""),
        ("below=1 km", ""),
        ("above=900 km", "above: holds at no time of the flight, whose altitude is 0 to 224 km"),
        ("speed_above=9 km/s", "speed_above: holds at no time of the flight, whose speed is 0 to 5600 m/s"),
    ],
)
def test_a_window_outside_the_flight_is_refused(study, setting: str, message: str) -> None:
    study.edit("campaign.yaml", "  imu: imu/good", "  imu: imu/good\n  sensors: {radar: altimeters/radar_004}")
    lines = reported(LISTED, f"sensors.radar.{setting}")
    assert [line.startswith(f"--set: base.sensors.radar.{message}") for line in lines] == [True] * bool(message)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("{kind: frozen_output, above: 900 km}", "above: holds at no time of the flight, whose altitude is"),
        ("{kind: frozen_output, start: 3 s, duration: 5 s, above: 9 km}", "above: holds at no time between the start"),
        ("{kind: frozen_output, from: 600 s}", "from: holds at no time of the flight (-60 s to 560 s)"),
        ("{kind: frozen_output, from: lift}", "from: 'lift': no event 'lift' (did you mean 'liftoff'?)"),
        ("{kind: frozen_output}", "start: is missing, or a condition such as from or above"),
        ("{kind: frozen_output, above: 9 km, until: stage1_cutoff}", ""),
    ],
)
def test_a_fault_that_holds_at_no_time_is_refused(study, fault: str, message: str) -> None:
    try:
        lines = reported(f"faults=[{fault}]")
    except InputError as error:
        lines = [str(one) for one in error.records]
    assert [line.startswith(f"--set: base.faults.0.{message}") for line in lines] == [True] * bool(message)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("underweighting=[{beta: 0.2, above: 900 km}]", "underweighting.0.above: holds at no time of the flight"),
        ("region_noise=[{velocity: 1 m/s, from: lift}]", "region_noise.0.from: 'lift': no event 'lift'"),
        ("underweighting=[{beta: 0.2, below: 9 km}]", ""),
    ],
)
def test_a_tuning_that_holds_at_no_time_is_refused(study, setting: str, message: str) -> None:
    lines = reported(f"filter.{setting}")
    assert [line.startswith(f"--set: base.filter.{message}") for line in lines] == [True] * bool(message)


def test_a_station_that_never_sees_the_vehicle_is_refused(study, flying) -> None:
    flying(hop())
    latitude, longitude, _ = geodetic_from_ecef(ecef_from_eci(SITE_R, earth_angle(0.3, 0.0)))
    place = f"latitude: {float(latitude)!r} rad, longitude: {float(longitude)!r} rad"
    card = f"card: ground_stations/c_band_radar, {place}"
    study.edit("campaign.yaml", "  imu: imu/good", f"  imu: imu/good\n  sensors: {{radar: {{{card}}}}}")
    listed = "filter.measurements=[ground_tracking]"
    assert reported(listed) == []
    message = "the station sees the vehicle at no time of the flight while its conditions hold"
    for setting, field in (("longitude=150 deg", "elevation_above"), ("longest_range=90 km", "elevation_above")):
        (line,) = reported(listed, f"sensors.radar.{setting}")
        assert line.endswith(f"base.sensors.radar.{field}: {message}")


def test_a_sensor_that_can_measure_at_no_time_is_refused(study, flying) -> None:
    flying(hop())
    tracker = "sensors={tracker: {card: star_trackers/miniature, highest_rate: 1 deg/h}}"
    (line,) = reported(tracker, "filter.measurements=[pseudorange, range_rate, stellar_attitude]")
    why = "Sun, Earth and body rate allow a solution at no time of the flight while its conditions hold"
    assert line == f"--set: base.sensors.tracker: {why}"


@pytest.mark.parametrize(
    ("start", "message"), [("-30 s", ""), ("liftoff", "from: the vehicle stands on its pad at no")]
)
def test_a_sensor_of_the_pad_is_used_before_the_lift_off(study, flying, start: str, message: str) -> None:
    flying(pad(45.0, 60.0))
    still = f"sensors={{still: {{kind: zero_velocity, name: a, source: b, sigma: 1 cm/s, from: {start}}}}}"
    lines = reported(still, "filter.measurements=[pseudorange, range_rate, zero_velocity]")
    assert [line.startswith(f"--set: base.sensors.still.{message}") for line in lines] == [True] * bool(message)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ("10 s", ""),
        ("10 h", "'10 h' is 36000 s: outside the flight"),
        ("injectoin", "no event 'injectoin' (did you mean 'injection'?)"),
    ],
)
def test_a_hand_over_is_within_the_flight(study, at: str, message: str) -> None:
    lines = reported(f"imu={{units: [imu/good, imu/good], selection: prime, hand_over: {at}}}")
    assert [message in line and "base.imu.hand_over: " in line for line in lines] == [True] * bool(message)
