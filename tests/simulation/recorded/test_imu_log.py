"""Logs of inertial units: rates and increments with units in the names of their columns, faults in one line."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.imu_log import read_log

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


def test_times_of_single_precision_are_even_again_or_named_as_such(tmp_path):
    week = _frame().assign(t_s=np.float32(4000.0) + (DT * np.arange(N)).astype(np.float32))  # 2.4e-4 s apart
    assert read_log(_written(week, tmp_path, "log.parquet")).dt == pytest.approx(DT, abs=1e-9)
    week = week.assign(t_s=(345_600.0 + DT * np.arange(N)).astype(np.float32))
    with pytest.raises(InputError, match=r"row 2: time 345600 s repeats: single precision resolves 0.0312 s here"):
        read_log(_written(week, tmp_path, "log.parquet"))


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


def _host(n: int = 600, missing: tuple[int, ...] = (), sigma: float = 1.5e-3) -> pd.DataFrame:
    """A log whose time stamps are a host's: scattered by `sigma` s, some rows perhaps missing."""
    rng = np.random.default_rng(3)
    frame = pd.DataFrame({"t_s": 5.0 + DT * np.arange(n) + sigma * rng.standard_normal(n)})
    for axis in "xyz":
        frame[f"gyro_{axis}_deg_h"], frame[f"accel_{axis}_mg"] = rng.standard_normal(n), 900.0
    return frame.drop(index=list(missing))


@pytest.mark.parametrize("sigma", [1.5e-3, 5e-3])
def test_stamps_of_a_host_are_named_for_what_they_are_and_may_be_counted(tmp_path, sigma):
    file = _written(_host(sigma=sigma), tmp_path)
    with pytest.raises(InputError) as fault:
        read_log(file)
    assert f"the time stamps scatter by {1e3 * sigma:.2g}"[:-1] in str(fault.value)
    assert "about 600 rows" in str(fault.value)
    assert "no row is missing" in str(fault.value)
    log = read_log(file, counts_rows=True)
    assert log.dt == pytest.approx(DT, rel=1e-3)
    assert np.ptp(np.diff(log.t)) < 1e-9


@pytest.mark.parametrize("missing", [(300,), (300, 301, 302), (5,)])
def test_a_row_that_is_missing_among_scattered_stamps_is_a_gap(tmp_path, missing):
    file = _written(_host(missing=missing), tmp_path)
    for counted in (False, True):
        with pytest.raises(InputError, match=r"log.csv:\d+: a gap: no rows between"):
            read_log(file, counts_rows=counted)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.assign(gyro_x_deg_h=f.gyro_x_deg_h.where(f.index != 4, 1e9)), "log.csv:6: a rate of 4848 rad/s"),
        (lambda f: f.assign(accel_x_mg=f.accel_x_mg.where(f.index != 4, 1e8)), "log.csv:6: a specific force of 9.8"),
        (lambda f: f.mul(np.where((f.index != 4)[:, None] | (f.columns == "t_s"), 1.0, 0.0)).assign(
            accel_z_mg=1000.0 * (f.index != 4)), "log.csv:6: all six columns are zero"),
    ],
)  # fmt: skip
def test_a_row_that_no_unit_puts_out_is_refused(tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        read_log(_written(change(_frame()), tmp_path))
