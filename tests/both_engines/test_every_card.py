"""Every field of the cards of sky, air, gravity, flights and control changes what is made of it, or is refused.

Sky, air and gravity are looked at in the prepared case of a short flight, a trajectory as the motion at the ticks of an
inertial unit, control as one launch flown. No filter flies. The fields are found in the card as it is written; their
other values are made by rule. Faults and sensors: test_every_setting.py; IMU, receiver, filter: test_fields.py;
almanacs and ephemerides of files: tests/gnss/test_satellites.py; air through which rays are traced: tests/delays.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lvnav_trade.gnss.constellation import CombinedConstellation, NominalConstellation
from lvnav_trade.gnss.delay_cards import AtmosphereCard
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.control_cards import SteeredCard
from lvnav_trade.trajectory.disturbances import GravityCard
from lvnav_trade.trajectory.flight import Trajectory, TrajectoryCard, build, reference
from lvnav_trade.trajectory.flights.orbital import OrbitalFlight
from lvnav_trade.trajectory.flights.sounding import SoundingFlight
from lvnav_trade.trajectory.guided.course import SolvedAscent, ascend
from lvnav_trade.trajectory.guided.missions import fly_missions, prepare_launch
from tests.building import SITE_R, flight, loaded, prepare_hop, turning, with_fields
from tests.trajectory import flight_cases
from tests.trajectory.guided.launches import settings
from tests.trajectory.tables import card as table_card
from tests.trajectory.tables import write
from tests.walking import digest, idle

OFF_NOMINAL = {
    "range_error": "0.5 m", "range_error_time": "90 s", "time_offset": "2 m", "time_offset_time": "500 s",
    "node_rate": "-5e-7 deg/s", "latitude_rate": "7.1e-3 deg/s",
    "eccentricity": 0.01, "perigee": "50 deg", "relativity": True,
}  # fmt: skip


@lru_cache(maxsize=1)
def base() -> Scenario:
    return loaded()


def of_scenario(trajectory: Trajectory | None = None, **parts: Any) -> str:
    """Digest of a prepared short flight of the scenario with other cards."""
    prepared_case = prepare_hop(base().model_copy(update=parts), trajectory)
    return digest(*(part for name, part in prepared_case._asdict().items() if name not in {"scenario", "trajectory"}))


def flight_digest(card: TrajectoryCard) -> str:
    """Digest of a true flight: its motion ten times a second, and its events."""
    flight = build(card)
    return digest(tuple(reference(flight, 10.0)), flight.events, flight.theta0, (flight.start, flight.end))


# --- sky, air, gravity ------------------------------------------------------------------------------------------------


def test_every_field_of_a_constellation_changes_what_is_computed() -> None:
    gps, galileo = base().constellation, loaded("base.constellation=constellations/galileo_24").constellation
    text = galileo.model_dump(mode="json")
    # rates of the first slot and of all others: each follows from the orbit where it is absent
    text["slots"][0] |= {"semi_major_axis": "29000 km", "inclination": "55 deg"}
    text["slots"][0] |= {"node_rate": "-4e-7 deg/s", "latitude_rate": "7e-3 deg/s"}
    text["slots"][0] |= {"eccentricity": 0.02, "perigee": "20 deg"}
    card = NominalConstellation.model_validate(text | OFF_NOMINAL)

    def beside(one: NominalConstellation) -> str:
        return of_scenario(constellation=CombinedConstellation(parts=(gps, one)))

    assert idle(card, beside) == []


MODELS: dict[str, dict[str, Any]] = {  # of the troposphere and of the ionosphere
    "any_elevation": {"kind": "klobuchar", "alpha": [1e-8, 2e-8, -6e-8, -6e-8], "beta": [9e4, 1e5, -1e5, -4e5]},
    "spilker": {"kind": "content"},
    "saastamoinen": {"kind": "content", "slant": "integrated"},
    "niell": {"kind": "epstein"},
    "stanag": {
        "kind": "klobuchar_content",
        "alpha": [1e-8, 2e-8, -6e-8, -6e-8],
        "beta": [9e4, 1e5, -1e5, -4e5],
    },
}
SCALES = {f"{what}_scale{end}": value for what in ("troposphere", "ionosphere")
          for end, value in (("", "10 percent"), ("_time", "100 s"))}  # fmt: skip


@lru_cache(maxsize=1)
def low() -> Trajectory:
    """A climb from two kilometres, in the air that the models are of."""
    r = SITE_R * (6.374e6 / np.linalg.norm(SITE_R))
    up = 12.0 * r / np.linalg.norm(r)
    return flight([(20.0, lambda t: up)], turning, r=r, v=np.cross([0.0, 0.0, 7.292115e-5], r))


@pytest.mark.parametrize("kind", MODELS)
def test_every_field_of_an_atmosphere_changes_what_is_computed(kind: str) -> None:
    card = AtmosphereCard.model_validate({"troposphere": {"kind": kind}, "ionosphere": MODELS[kind], **SCALES})
    sky = loaded("base.constellation=constellations/gps_galileo_glonass").constellation  # some are near the horizon
    heard = {"constellation": sky, "receiver": with_fields(base().receiver, mask="-5 deg", channels=60)}
    assert idle(card, lambda one: of_scenario(low(), atmosphere=one, **heard)) == []


def test_every_field_of_a_gravity_disturbance_changes_what_is_computed() -> None:
    assert idle(GravityCard(sigma="30 mGal", time="20 s"), lambda one: of_scenario(gravity=one)) == []


# --- control ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def ascent() -> SolvedAscent:
    return ascend(VehicleAscent.model_validate(flight_cases.launcher_settings("churchill_sso")))


def launched(card: SteeredCard) -> str:
    """Digest of one launch of a vehicle under control."""
    launch = prepare_launch(ascent(), card.rotation, card.controller, card.wind, card.imu, card.envelope)
    return digest(fly_missions(launch, card.feedback, 1, first_run=card.realisation).history)


def test_every_field_of_control_changes_a_launch() -> None:
    controller = settings("controllers/three_motor")
    controller["turns"] = [{"start": "stage1_cutoff - 20 s", "axis": "yaw", "angle": "5 deg", "duration": "10 s"}]
    controller["guidance"] |= {"command_sigma": "0.1 deg"}
    card = SteeredCard.model_validate({
        "rotation": settings("rotation/three_motor"), "controller": controller, "wind": settings("wind/moderate"),
        "imu": settings("imu/kvh1750_003") | {"rate": "20 Hz"}, "feedback": {},
        "envelope": EnvelopeCard().model_dump(mode="json"),
    })  # fmt: skip
    assert idle(card, launched, without={"imu"}) == []  # of the unit only the gyro feeds the controller


# --- flights ----------------------------------------------------------------------------------------------------------

SHAKEN = [{
    "start": "10 s", "end": "30 s", "ramp": "2 s",
    "coning": [{"angle": "0.2 deg", "frequency": "2 Hz", "phase": "0.3 rad"}],
    "tones": [{"frequency": "3 Hz", "axis": "y", "phase": "0.2 rad", "angle": "1 mrad"}],
    "noise": [{"frequency": ["2 Hz", "4 Hz"], "lines": 8, "acceleration": ["0.001 g^2/Hz", "0.002 g^2/Hz"]}],
}]  # fmt: skip


def test_every_field_of_a_users_table_changes_its_flight(tmp_path: Path) -> None:
    columns = {**{f"q{k}": np.full(161, float(k == 0)) for k in range(4)}}
    turned = {"form": "quaternion", "frame": "ecef", "columns": [*columns], "scalar": "first", "turns": "body_to_frame"}
    noise = {"position_noise": "1 cm", "velocity_noise": "1 cm/s", "attitude_noise": "1 mrad"}
    with_attitude = table_card(write(tmp_path, columns, attitude=turned, largest_force_angle="180 deg", **noise))
    pointed = {"pointing": "velocity", "roll": {"pad": "20 deg", "flight": "40 deg"}, "pad_hold": "20 s"}
    without = table_card(write(tmp_path, name="second.csv", oscillation=SHAKEN, greenwich="1 rad", **pointed))
    beside = {"smallest_jump", "position_noise"}  # of what rows of position are held against: tests/world/user_file
    assert {*idle(with_attitude, flight_digest, beside)} & {*idle(without, flight_digest, beside)} == set()


@pytest.mark.slow
def test_every_field_of_an_orbital_flight_changes_it() -> None:
    card = OrbitalFlight.model_validate(flight_cases.orbital_settings(
        orbit={"perigee": "-4000 km", "apogee": "90 km", "inclination": "60 deg", "node": "10 deg",
               "perigee_argument": "30 deg", "latitude_argument": "205 deg"},
        legs=[{"name": "coast", "duration": "20 s", "attitude": "prograde", "pitch": "3 deg", "yaw": "2 deg"},
              {"name": "burn", "duration": "20 s", "thrust": "2 kN", "specific_impulse": "220 s", "pitch": "5 deg",
               "yaw": "4 deg", "attitude": "horizontal", "slew": "10 s"}],
        descent={"altitude": "20 km", "attitude": "airspeed", "slew": "20 s", "pitch": "2 deg", "yaw": "3 deg",
                 "parachutes": [{"name": "drogue", "below": "30 km", "drag_area": "4 m^2"}]},
        oscillation=SHAKEN, assumed={},
    ))  # fmt: skip
    assert idle(card, flight_digest) == []


@pytest.mark.slow
def test_every_field_of_a_sounding_rocket_changes_its_flight() -> None:
    stages = [
        {"name": "first", "propellant": "60 kg", "dry": "20 kg", "burn_time": "5 s", "specific_impulse": "220 s",
         "exit_area": "0.01 m^2", "separation_delay": "1 s"},
        {"name": "second", "propellant": "20 kg", "dry": "10 kg", "burn_time": "5 s", "specific_impulse": "220 s",
         "exit_area": "0.01 m^2", "ignition_delay": "5 s", "separation_delay": "2 s", "elevation": "75 deg"},
    ]  # fmt: skip
    card = SoundingFlight.model_validate(flight_cases.sounding_settings(
        rail={"azimuth": "348 deg", "elevation": "84 deg", "length": "10 m"}, stages=stages, payload="20 kg",
        reference_area="0.03 m^2", apogee=None, weathercock="2 s", held_above="2 km", turn_time="3 s",
        spin=[{"at": "rail_exit", "frequency": "1.7 Hz", "over": "2 s"}], end_altitude="3 km", pad_hold="10 s",
        assumed={},
    ))  # fmt: skip
    assert idle(card, flight_digest) == []


@pytest.mark.slow
def test_every_field_of_a_recorded_ascent_changes_its_flight() -> None:
    assert idle(flight_cases.record_card(), flight_digest) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_stage_leo", "pslv_sub_gto"])
def test_every_field_of_a_launch_changes_its_flight(name: str) -> None:
    settings_of = flight_cases.launcher_settings(name)
    assert idle(VehicleAscent.model_validate(settings_of), flight_digest, without={"recorded"}) == []
