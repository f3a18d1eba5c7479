"""Logs of inertial units: rates and increments with units in the names of their columns, faults in one line."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.world.user_file.imu_log import read_log

N, DT = 20, 0.01


def _frame(gyro: str = "deg_h", accel: str = "mg", time: str = "t_s", factor: float = 1.0) -> pd.DataFrame:
    frame = pd.DataFrame({time: factor * (5.0 + DT * np.arange(N))})
    for k, axis in enumerate("xyz"):
        frame[f"gyro_{axis}_{gyro}"] = k + 0.1 * np.arange(N)
        frame[f"accel_{axis}_{accel}"] = 10.0 * k + np.arange(N)
    return frame


def _written(frame: pd.DataFrame, folder, name: str = "log.csv") -> str:
    file = folder / name
    frame.to_parquet(file) if name.endswith(".parquet") else frame.to_csv(file, index=False)
    return str(file)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_rates_are_in_si(tmp_path, name):
    log = read_log(_written(_frame(), tmp_path, name))
    assert log.dt == pytest.approx(DT)
    assert log.gyro[3, 1] == pytest.approx(math.radians(1.3) / 3600.0)
    assert log.accel[4, 2] == pytest.approx(24.0 * 9.80665e-3)


def test_units_may_be_written_as_in_the_tables_of_the_tool(tmp_path):
    log = read_log(_written(_frame("rad_per_s", "m_per_s2", "time_s"), tmp_path))
    assert log.gyro[3, 1] == pytest.approx(1.3)
    assert log.accel[4, 2] == pytest.approx(24.0)


def test_increments_are_divided_by_the_interval_and_time_has_its_unit(tmp_path):
    log = read_log(_written(_frame("arcsec", "mm_s", "time_us", 1e6), tmp_path))
    assert log.t[1] - log.t[0] == pytest.approx(DT)
    assert log.gyro[3, 1] == pytest.approx(math.radians(1.3 / 3600.0) / DT)
    assert log.accel[4, 2] == pytest.approx(24.0e-3 / DT)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.drop(index=[7, 8]), "log.csv:9: a gap"),
        (lambda f: f.assign(t_s=f.t_s + 0.3 * DT * (f.index == 9)), "log.csv:11: uneven sampling"),
        (lambda f: f.assign(t_s=f.t_s.where(f.index != 9, f.t_s[8])), "log.csv:11: time 0.08 s repeats"),
        (lambda f: f.assign(accel_y_mg=f.accel_y_mg.where(f.index != 4)), "accel_y_mg is"),
        (lambda f: f.drop(columns="gyro_z_deg_h"), "no columns gyro_x_UNIT"),
        (lambda f: f.rename(columns={"t_s": "clock"}), "no column of time"),
        (lambda f: f.head(5), "5 rows of data, a log needs 12 or more"),
    ],
)
def test_faults_are_named_with_their_place(tmp_path, change, said):
    with pytest.raises(InputError) as fault:
        read_log(_written(change(_frame()), tmp_path))
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


def test_a_part_of_a_log_is_counted_from_its_first_row(tmp_path):
    frame = _frame()
    frame.loc[frame.index[-1], "t_s"] += 3.0  # a gap behind the part does not matter
    file = _written(frame, tmp_path)
    assert read_log(file, start=0.05, end=0.18).t[0] == pytest.approx(5.05)
    with pytest.raises(InputError, match=r"rows from 0 to 0\.03 s"):
        read_log(file, end=0.03)
    with pytest.raises(InputError, match="a gap"):
        read_log(file)
