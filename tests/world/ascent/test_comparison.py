"""A flight against its own record, and against one that is known to be off."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.world.ascent.comparison import differences
from lvnav_trade.world.ascent.vehicle import Recorded
from lvnav_trade.world.truth import motion
from tests.world.flights import ascent, ascent_card


def record_of(tmp_path, speed_off=0.0, altitude_off=0.0):
    t = np.linspace(0.0, ascent().events["injection"], 30)
    m = motion(ascent(), t)
    speed = np.linalg.norm(earth_velocity(m.r_i, m.v_i), axis=1) + speed_off
    height = geodetic_from_ecef(ecef_from_eci(m.r_i, earth_angle(ascent().theta0, t)))[2] - 20.0 + altitude_off
    path = tmp_path / "record.csv"
    rows = [f"{a!r},{abs(b)!r},{c!r}" for a, b, c in zip(t.tolist(), speed.tolist(), height.tolist(), strict=True)]
    path.write_text("\n".join(["time_s,speed_m_s,altitude_m", *rows]))
    return str(path)


def compared(**given):
    return differences(Recorded(source="a record", **given), ascent(), ascent_card().site)


def test_a_flight_does_not_differ_from_its_own_record(tmp_path):
    facts = compared(file=record_of(tmp_path))
    assert facts["compared_with"] == "a record"
    assert facts["record_speed_rms_m_s"] < 1e-6
    assert facts["record_altitude_rms_m"] < 1e-6


def test_a_constant_difference_is_its_own_rms_flight_minus_record(tmp_path):
    facts = compared(file=record_of(tmp_path, 3.0, -40.0))
    assert facts["record_speed_rms_m_s"] == pytest.approx(3.0, abs=1e-6)
    assert facts["record_speed_worst_m_s"] == pytest.approx(-3.0, abs=1e-6)
    assert facts["record_altitude_rms_m"] == pytest.approx(40.0, abs=1e-5)
    assert facts["record_altitude_worst_m"] == pytest.approx(40.0, abs=1e-5)


def test_events_tell_how_much_later_they_are():
    facts = compared(events={"stage1_cutoff": "150 s", "an_event_of_the_record_alone": "1 s"})
    assert facts["stage1_cutoff_after_record_s"] == pytest.approx(ascent().events["stage1_cutoff"] - 150.0)
    assert "an_event_of_the_record_alone_after_record_s" not in facts


def test_a_record_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        compared(file=str(tmp_path / "absent.csv"))
