"""Numbers of a vehicle under control as metrics."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluate import evaluate, evaluate_single, name_of
from tests import vehicle_tables
from tests.scripts import publication


@pytest.fixture(autouse=True, scope="module")
def _script(_clean):
    publication("drdc")


def test_the_part_of_ticks_in_an_envelope_is_that_of_the_worse_rate():
    tables = vehicle_tables.tables()
    rows = tables.motion_statistics.copy()
    rows.loc[(rows.controller_rate == "raw") & (rows.axis == "pitch"), "angular_acceleration_inside_ratio"] = 0.9
    rows.loc[(rows.controller_rate == "true"), "angular_acceleration_inside_ratio"] = 0.1  # is not flown
    coast = rows.assign(phase="coast", tick_count=3000, angular_acceleration_inside_ratio=1.0)
    tables.__dict__["motion_statistics"] = pd.concat([rows, coast], ignore_index=True)
    whole, burn, yaw, jerk = (
        evaluate_single(tables, "aaaaaaaaaaaa", {"metric": name}, "%").value
        for name in ("turning_inside_pitch", "turning_inside_pitch_burn", "turning_inside_yaw_burn", "jerk_inside_yaw")
    )
    assert whole == pytest.approx(97.5)
    assert (burn, yaw, jerk) == pytest.approx((90.0, 99.0, 100.0))
    assert np.isnan(evaluate_single(tables, "aaaaaaaaaaaa", {"metric": "turning_inside_yaw_change"}, "%").value)


def test_a_nozzle_moves_less_in_a_burn_and_over_the_flight():
    tables = vehicle_tables.tables()
    found = [
        evaluate_single(tables, "aaaaaaaaaaaa", {"metric": f"nozzle_movement_pitch{part}"}, "%").value
        for part in ("", "_burn_1")
    ]
    assert found == pytest.approx([70.0, 70.0])
    each = evaluate_single(tables, "aaaaaaaaaaaa", {"metric": "nozzle_movement_yaw"}, "%").runs
    assert each == pytest.approx([35.0] * vehicle_tables.RUNS)  # one reduction of each pair of runs
    assert np.isnan(evaluate_single(tables, "aaaaaaaaaaaa", {"metric": "nozzle_movement_pitch_burn_2"}, "%").value)
    assert evaluate(tables, "aaaaaaaaaaaa", {"metric": "nozzle_movement_yaw"}, "%").monte_carlo == pytest.approx(35.0)


def test_the_name_says_what_moves_and_when():
    assert (
        name_of({"metric": "nozzle_movement_yaw_burn_2"}) == "nozzle_movement_yaw, less with the filtered rate, burn 2"
    )
    assert name_of({"metric": "turning_inside_pitch_coast"}) == "turning_inside_pitch, part of ticks, coast"
