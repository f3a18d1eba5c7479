"""Flights beyond what is usual: refused at the field that would allow them, or flown with a remark."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.ascent.plausibility import peaks
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY
from lvnav_trade.trajectory.flight import build
from lvnav_trade.trajectory.truth import BEYOND
from tests.trajectory.flight_cases import recorded, sounding
from tests.trajectory.tables import BREAK, card, path, write

T = np.arange(0.0, 80.25, 0.02)


def table(tmp_path, boost=0.0, roll=0.0, pitch=0.0, **own):
    """The climb of `path` at 50 Hz with a boost (m/s^2) from 50 to 60 s, in which its body turns at rates (rad/s)."""
    r, v = path(T)
    up = r[0] / np.linalg.norm(r[0])
    during, later = np.clip(T - 50.0, 0.0, 10.0), np.maximum(T - 60.0, 0.0)
    r = r + np.outer(boost * (0.5 * during**2 + 10.0 * later), up)
    v = v + np.outer(boost * during, up)
    x, z = up, np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
    y = np.cross(z, x)
    start = np.stack([x, y, z], axis=-1)
    turns = []
    for one in during:
        a, b = one * roll, one * pitch
        about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
        about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
        turns.append((start @ about_y @ about_x).ravel())
    names = [f"c{k}" for k in range(9)]
    columns = {"t": T, **dict(zip("xyz", r.T, strict=True)), **dict(zip(("vx", "vy", "vz"), v.T, strict=True))}
    columns |= dict(zip(names, np.array(turns).T, strict=True))
    attitude = {"form": "matrix", "frame": "eci", "columns": names, "turns": "body_to_frame"}
    events = {"cutoff": f"{BREAK} s", "boost": "50 s", "end_of_boost": "60 s"}
    settings = {"attitude": attitude, "events": events, "largest_force_angle": "180 deg", **own}
    return card(write(tmp_path, columns, **settings))


def remarks(flight):
    return [one.text for one in flight.remarks if one.category == BEYOND]


def refusals(own):
    with pytest.raises(InputError) as caught:
        build(own)
    return caught.value.records


@pytest.mark.parametrize(
    ("changes", "field", "text", "allowed"),
    [
        ({"boost": 330.0}, "highest_load", r"specific force of 35\.", "40 g"),
        ({"pitch": 3.0}, "highest_rate", r"pitch and yaw rate of 1\d\d", "200 deg/s"),
        ({"roll": 45.0}, "highest_spin", r"roll rate of 3\d\d\d", "4000 deg/s"),
    ],
)
def test_beyond_the_usual_a_table_is_refused_at_the_field_that_lets_it_fly(tmp_path, changes, field, text, allowed):
    (record,) = refusals(table(tmp_path, **changes))
    assert record.path == f"trajectory.{field}"
    assert record.message.startswith(f"{tmp_path}/mine.csv: ")
    assert record.message.endswith(f"; if it is true, raise {field}")
    assert re.search(text, record.message)
    assert " is usual: " in record.message
    assert pytest.approx(55.0, abs=7.0) == float(record.message.split(" at ")[1].split()[0])
    (line,) = remarks(build(table(tmp_path, **changes, **{field: allowed})))
    assert line.split(",")[0].endswith(")")
    assert "usually at most" in line


def test_a_limit_that_is_raised_too_little_is_named_as_it_stands(tmp_path):
    (record,) = refusals(table(tmp_path, boost=330.0, highest_load="30 g"))
    assert "at most 30 g is allowed" in record.message


def test_a_limit_may_be_lower_than_usual_and_one_that_nothing_exceeds_says_nothing(tmp_path):
    assert remarks(build(table(tmp_path))) == []
    assert remarks(build(table(tmp_path, highest_load="90 g", highest_rate="900 deg/s"))) == []
    (record,) = refusals(table(tmp_path, highest_load="2 g"))
    assert "at most 2 g is allowed" in record.message


def test_everything_that_is_beyond_is_named_at_once(tmp_path):
    own = table(tmp_path, boost=330.0, pitch=3.0)
    assert [one.path for one in refusals(own)] == ["trajectory.highest_load", "trajectory.highest_rate"]
    (line,) = remarks(build(own.model_copy(update={"highest_load": 1e4, "highest_rate": 100.0})))
    assert "specific force" in line
    assert "pitch and yaw rate" in line


def test_the_shipped_record_and_a_spinning_sounding_rocket_are_usual():
    found = {one.field: one for one in peaks(recorded())}
    assert 3.0 < found["highest_load"].size / STANDARD_GRAVITY < 6.0
    assert max(found["highest_rate"].size, found["highest_spin"].size) < math.radians(5.0)
    spinning = {one.field: one.size for one in peaks(sounding())}
    assert spinning["highest_spin"] == pytest.approx(2.0 * math.pi * 1.7, rel=1e-3)
    assert spinning["highest_load"] < 25.0 * STANDARD_GRAVITY
    assert spinning["highest_rate"] < math.radians(30.0)
