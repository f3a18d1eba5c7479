"""A record as it comes: 30 rows a second read off the overlay of a webcast, with holes and a gap after injection."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity
from lvnav_trade.trajectory.ascent.profile import rebuild
from lvnav_trade.trajectory.truth import NOTE, motion
from tests.trajectory.flight_cases import record_card, recorded

STAGES = {"stage1_cutoff": "150 s", "stage2_ignition": "161 s"}
RAW = "launch/falcon9_formosat5/stage2_raw.json"


@pytest.fixture(scope="module")
def raw(refdata):
    """Time (s), speed (m/s), altitude (m), (n, 3)."""
    found = json.loads((refdata / RAW).read_text())
    rows = np.column_stack([found["time"], found["velocity"], 1e3 * np.array(found["altitude"])])
    return rows[np.append(True, np.diff(rows[:, 0]) > 0.0)]


def written(folder, rows, **changes):
    lines = [",".join(f"{value:.3f}" for value in row) for row in rows]
    (folder / "raw.csv").write_text("\n".join(["time_s,speed_m_s,altitude_m", *lines]))
    return record_card(file=str(folder / "raw.csv"), **changes)


def test_the_raw_record_flies_with_its_holes_filled_and_its_gap_behind_injection(raw, tmp_path, record_property):
    interval = np.diff(raw[:, 0])
    assert np.max(interval) > 100.0  # the gap
    assert np.max(interval[raw[1:, 0] < 558.0]) > 20.0 * np.median(interval)  # holes
    with pytest.raises(
        InputError, match=r"pitch and yaw rate of .* at 55[78].* is a row wrong there, an event early or late"
    ):
        rebuild(written(tmp_path, raw))  # thrust ends before 558 s, the time given to a second
    flight = rebuild(written(tmp_path, raw, events={**STAGES, "stage2_cutoff": "557 s", "injection": "557 s"}))
    (note,) = (one.text for one in flight.remarks if one.category == NOTE)
    assert "holes without data, the longest from " in note
    t = np.linspace(20.0, 555.0, 400)
    fine, coarse = (motion(one, t) for one in (flight, recorded()))
    speeds = [np.linalg.norm(earth_velocity(one.r_i, one.v_i), axis=1) for one in (fine, coarse)]
    assert np.sqrt(np.mean((speeds[0] - speeds[1]) ** 2)) < 4.0
    record_property("raw record at 30 Hz", {name: flight.facts[name] for name in ("max_load_g", "smoothing_misfit")})


def test_wrong_digits_in_the_raw_record_are_refused(raw, tmp_path):
    rows, rng = raw[::15].copy(), np.random.default_rng(4)
    wrong = (rng.random(len(rows)) < 0.1) & (rows[:, 0] > 20.0)
    rows[wrong, 1] += 100.0 / 3.6  # km/h, the third digit from the right one too large
    rows[wrong[::-1], 2] = np.round(rows[wrong[::-1], 2] + 8e3)
    with pytest.raises(InputError) as caught:
        rebuild(written(tmp_path, rows))
    assert "trajectory.highest_misfit" in [one.path for one in caught.value.records]
