"""NASA's check-case 17 (two stages to orbit, TM-2015-218675) as a user's own file: feet, 37 columns, 10 Hz.

Its position is that of a point which moves in the body at 0.2 m/s while the first stage burns, by 4.6 m at staging, and
at 14 mm/s while the second burns; its velocity is not. Event times are those at which its acceleration jumps: the first
cut-off from the fraction of the interval without thrust, staging 96.79 s later as its README says, the second likewise.
"""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.table_flight import residuals
from lvnav_trade.trajectory.flight import build, motion, refuse_contradiction
from lvnav_trade.trajectory.truth import BEYOND

FILE = "launch/nesc_atmos17/Atmos_17_sim_06.csv"
FOOT = 0.3048
MOVING = [["liftoff", "stage1_cutoff"], ["stage2_ignition", "stage2_cutoff"]]


def settings(path, **own):
    def xyz(name):
        return [f"{name}_{axis}" for axis in "XYZ"]

    return TableTrajectory.model_validate(
        {
            "name": "check-case 17",
            "source": "NASA TM-2015-218675",
            "epoch": "2015-01-01T00:00:00Z",
            "file": str(path),
            "greenwich": "0 deg",
            "time": {"column": "time", "unit": "s"},
            "position": {"frame": "eci", "columns": xyz("eiPosition_ft"), "unit": "ft"},
            "velocity": {"frame": "eci", "columns": xyz("eiVelocity_ft_s"), "unit": "ft/s"},
            "attitude": {
                "form": "euler",
                "frame": "ned",
                "columns": [f"eulerAngle_deg_{axis}" for axis in ("Yaw", "Pitch", "Roll")],
                "unit": "deg",
            },
            "events": {"stage1_cutoff": "37.383 s", "stage2_ignition": "134.1745 s", "stage2_cutoff": "195.368 s"},
            "highest_load": "30 g",
            **own,
        }
    )


def imu(root, name):
    return ImuCard.model_validate(YAML(typ="safe").load((root / f"configs/imu/{name}.yaml").read_text()))


@pytest.fixture(scope="module")
def flight(refdata):
    return build(settings(refdata / FILE, moving_reference=MOVING))


def changes(facts):
    """Return the removed changes of the reference point: name to size in m."""
    numbers = range(1, 1 + sum(key.endswith("_at_s") and key.startswith("reference_change") for key in facts))
    return {facts[f"reference_change_{k}"]: facts[f"reference_change_{k}_m"] for k in numbers}


def test_the_jump_at_staging_is_named_and_removed(flight, record_property):
    found = changes(flight.facts)
    assert found["stage2_ignition"] == pytest.approx(4.62, abs=0.03)  # 4.6 m at 134.1 s
    assert found["liftoff to stage1_cutoff"] == pytest.approx(0.2 * 37.38, abs=0.1)
    assert found["stage2_ignition to stage2_cutoff"] == pytest.approx(0.0139 * 61.2, abs=0.02)
    near = np.array([134.05, 134.15, 134.25])
    speed = np.diff(motion(flight, near).r_i, axis=0) / 0.1
    assert np.max(np.linalg.norm(np.diff(speed, axis=0), axis=1)) < 6.0  # 51 m/s^2 over 0.1 s; the jump were 46 m/s
    record_property("check-case 17: removed changes, m", {name: round(size, 3) for name, size in found.items()})


def test_what_is_left_is_below_a_tenth_of_every_shipped_unit(refdata, root, record_property):
    own = settings(refdata / FILE, moving_reference=MOVING)
    for name in ("navigation", "tactical_fog", "tactical_mems"):
        refuse_contradiction(own, imu(root, name))
    worst = max((one for one in residuals(own) if one.quantity == "position"), key=lambda one: one.size)
    assert worst.size < 1e-3
    record_property("check-case 17: worst position residual", f"{worst.size * 1e3:.2f} mm at {worst.time:.1f} s")


def test_the_load_of_its_second_burn_is_beyond_the_usual_and_said(flight, refdata):
    (remark,) = flight.remarks
    assert remark.category == BEYOND
    assert re.match(r"specific force of 26\.[89]\d* g at 195\.\d+ s \(usually at most 25 g\)", remark.text)
    with pytest.raises(InputError, match=r"specific force of 26\.[89].* at most 25 g is usual: .* raise highest_load"):
        build(settings(refdata / FILE, moving_reference=MOVING, highest_load="25 g"))


def test_undeclared_the_moving_point_is_refused_and_the_jump_too(refdata, root):
    with pytest.raises(InputError, match=r"by 7\.43 m at 37\.3 s \(from 0 s on\); allowed are 1\.37 m"):
        refuse_contradiction(settings(refdata / FILE), imu(root, "tactical_fog"))
    with pytest.raises(
        InputError, match=r"steps by 4\.62 m more than its velocity between 134\.1 and 134\.2 s, where no"
    ):
        build(settings(refdata / FILE, events={}))


def test_position_alone_shows_the_same_jump(refdata):
    own = settings(refdata / FILE, velocity=None)
    facts = build(own).facts
    assert changes(facts) == {"stage2_ignition": pytest.approx(4.62, abs=0.03)}
    assert facts["position_misfit_worst_m"] < 1e-6
    assert residuals(own) == tuple(one for one in residuals(own) if one.quantity == "attitude")


def test_the_flight_ends_where_the_file_does_less_what_was_removed(refdata, flight):
    last = pd.read_csv(refdata / FILE).iloc[-1]
    end = motion(flight, [flight.end])
    theta0 = flight.theta0  # the file's x axis is at Greenwich at lift-off, ours is not
    turn = earth_angle(theta0, 0.0)
    position = ecef_from_eci(end.r_i[0], turn) - FOOT * np.array([last[f"eiPosition_ft_{axis}"] for axis in "XYZ"])
    velocity = ecef_from_eci(end.v_i[0], turn) - FOOT * np.array([last[f"eiVelocity_ft_s_{axis}"] for axis in "XYZ"])
    assert np.linalg.norm(velocity) < 1e-6
    removed = sum(changes(flight.facts).values())  # they lie along the body, which pitches over by 43 deg
    assert 0.8 * removed < np.linalg.norm(position) < removed
    latitude, longitude, height = geodetic_from_ecef(ecef_from_eci(end.r_i, earth_angle(theta0, flight.end)))
    assert np.degrees(longitude[0]) == pytest.approx(last.longitude_deg, abs=2e-4)
    assert np.degrees(latitude[0]) == pytest.approx(last.latitude_deg, abs=1e-9)
    assert height[0] == pytest.approx(FOOT * last.altitudeMsl_ft, abs=12.0)


def test_thrust_lies_along_the_files_own_roll_axis(flight):
    # open loop, no gimbal: in vacuum the specific force is along the axis
    m = motion(flight, np.linspace(136.0, 194.0, 200))
    assert np.max(np.abs(m.f_b[:, 1:])) < 1e-3 * np.min(m.f_b[:, 0])


def test_the_geodetic_columns_say_the_same_as_the_inertial_ones(refdata, flight):
    own = settings(
        refdata / FILE,
        moving_reference=MOVING,
        greenwich=None,
        position={"frame": "geodetic", "columns": ["latitude_deg", "longitude_deg", "altitudeMsl_ft"], "unit": "deg",
                  "height_unit": "ft"},
        velocity={"frame": "ned", "columns": [f"feVelocity_ft_s_{axis}" for axis in "XYZ"], "unit": "ft/s"},
    )  # fmt: skip
    t = np.linspace(0.0, 200.0, 800)
    a, b = motion(build(own), t), motion(flight, t)
    assert np.max(np.abs(a.r_i - b.r_i)) < 1e-3
    assert np.max(np.abs(a.v_i - b.v_i)) < 1e-5
