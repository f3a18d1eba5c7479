"""Tables of a vehicle under control hold what the missions left."""

from __future__ import annotations

import numpy as np

from lvnav_trade.results.tables.controlled_tables import controlled_columns
from lvnav_trade.simulation.nozzle import NozzleStatistics


def found() -> NozzleStatistics:
    rng = np.random.default_rng(1)
    turning = rng.uniform(0.1, 1.0, (3, 2, 3, 8))
    turning[:, :, 1, 0] = 0.0  # no coast
    turning[:, :, [0, 2], 0] = 100.0
    return NozzleStatistics(
        t=np.arange(3.0), total=rng.uniform(size=(3, 4, 2, 2)),
        mean=rng.uniform(size=(3, 3, 2)), low=np.zeros((3, 3, 2)), high=np.ones((3, 3, 2)), turning=turning,
        bin_time=np.arange(5.0), bin_motion=rng.uniform(size=(5, 2, 4)),
    )  # fmt: skip


def test_every_run_feed_burn_and_axis_has_its_row():
    missions, rows = found(), controlled_columns(found())["nozzle_travel"]
    keys = list(zip(rows["controller_rate"], rows["run_number"], rows["burn"], rows["axis"], strict=True))
    at = [i for i, key in enumerate(keys) if key == ("filtered", 2, "burn 1", "yaw")]
    assert rows["travel_rad"][at].tolist() == [missions.total[1, 2, 1, 1]]
    assert len(rows["controller_rate"]) == 3 * 4 * 2 * 2


def test_phases_that_there_are_not_are_left_out():
    rows = controlled_columns(found())["motion_statistics"]
    assert set(rows["phase"]) == {"burn", "change"}
    assert rows["angular_acceleration_inside_ratio"][0] == found().turning[0, 0, 0, 1]
    assert len(rows["rate_sigma_rad_per_s"]) == 12


def test_motion_and_movement_are_by_axis():
    tables, missions = controlled_columns(found()), found()
    yaw = np.array(tables["motion_history"]["axis"]) == "yaw"
    np.testing.assert_array_equal(tables["motion_history"]["jerk_m_per_s3"][yaw], missions.bin_motion[:, 1, 2])
    chosen = (np.array(tables["nozzle_travel_history"]["controller_rate"]) == "true") & (
        np.array(tables["nozzle_travel_history"]["axis"]) == "pitch"
    )
    np.testing.assert_array_equal(tables["nozzle_travel_history"]["mean_rad"][chosen], missions.mean[2, :, 0])
