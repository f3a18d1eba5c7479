"""The card that a log gives: read again as a unit, intervals as comments, what it cannot show left out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.unit_card import fit_unit
from lvnav_trade.covariance.diagnostics.imu_stream import stream_at_rest
from lvnav_trade.imu.allan import overlapping
from lvnav_trade.quantities.errors import InputError
from tests.building import case

GYRO, ACCEL = 3e-5, 1e-3  # rad/sqrt(s), m/s^1.5


def log_of(folder, n: int = 20_000, dt: float = 0.1, walk: float = 0.0) -> str:
    """Write a log of white noise, and of a random walk of the x gyro's rate, beside a constant; return its name."""
    rng = np.random.default_rng(11)
    frame = pd.DataFrame({"t_s": dt * np.arange(n)})
    for axis in "xyz":
        frame[f"gyro_{axis}_rad_s"] = 7e-5 + GYRO / np.sqrt(dt) * rng.standard_normal(n)
        frame[f"accel_{axis}_m_s2"] = 9.8 * (axis == "z") + ACCEL / np.sqrt(dt) * rng.standard_normal(n)
    frame["gyro_x_rad_s"] += walk * np.sqrt(dt) * np.cumsum(rng.standard_normal(n))
    file = folder / "rest.parquet"
    frame.to_parquet(file)
    return str(file)


def test_white_noise_is_on_the_card_and_the_rest_is_a_comment_with_its_bound(tmp_path):
    found = fit_unit(log_of(tmp_path))
    rows = found.coefficients.set_index(["sensor", "coefficient"])
    one = rows.loc[("accelerometer z", "random_walk")]
    assert one.low <= ACCEL * 60.0 <= one.high
    assert one.high / one.low < 1.05
    assert "  # bias_instability: not shown, below" in found.text
    assert "\n  bias_instability" not in found.text
    assert found.rate == pytest.approx(10.0)


def test_an_axis_that_does_not_show_what_another_shows_is_zero(tmp_path):
    text = fit_unit(log_of(tmp_path, walk=3e-6)).text
    line = next(line for line in text.splitlines() if line.startswith("  rate_random_walk"))
    assert line.endswith('"0 deg/h/sqrt(h)", "0 deg/h/sqrt(h)"]')


def test_curves_have_their_interval_about_the_deviation(tmp_path):
    curves = fit_unit(log_of(tmp_path)).curves
    assert (curves.low_si < curves.deviation_si).all()
    assert (curves.deviation_si < curves.high_si).all()
    assert set(curves.sensor) == {f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"}


def test_a_log_that_is_too_short_or_never_changes_is_refused(tmp_path):
    file = log_of(tmp_path, 3000)
    with pytest.raises(InputError, match="too short: 101 rows"):
        fit_unit(file, 0.0, 10.0)
    with pytest.raises(InputError, match="too short: 3000 rows, 300 s, 3 averaging times"):
        fit_unit(file, shortest=1.0, longest=2.0)
    pd.read_parquet(file).assign(gyro_y_rad_s=1.0).to_parquet(file)
    with pytest.raises(InputError, match="gyro y never changes"):
        fit_unit(file)


def flicker(n: int, dt: float, coefficient: float, rng: np.random.Generator) -> np.ndarray:
    """Return means (n,) over dt s of flicker noise, a two-sided spectrum of B^2 / (2 pi f) (IEEE 952)."""
    f = np.fft.rfftfreq(2 * n, dt)
    shape = np.concatenate([[0.0], coefficient / np.sqrt(2.0 * np.pi * f[1:] * dt)])
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * n)) * shape, 2 * n)[:n]


def test_the_floor_of_a_log_is_the_floor_of_the_stream_that_its_card_simulates(tmp_path):
    n, dt, floor = 60_000, 0.1, np.radians(14.5 / 3600.0)
    rng = np.random.default_rng(4)
    frame = pd.DataFrame({"t_s": dt * np.arange(n)})
    for axis in "xyz":
        frame[f"gyro_{axis}_rad_s"] = flicker(n, dt, floor / 0.664, rng) + 2e-5 * rng.standard_normal(n)
        frame[f"accel_{axis}_m_s2"] = 1e-3 * rng.standard_normal(n)
    frame.to_parquet(tmp_path / "rest.parquet")
    found = fit_unit(str(tmp_path / "rest.parquet"))
    assert "convention: coefficient" in found.text
    card = tmp_path / "unit.yaml"
    card.write_text(found.text)
    prepared_case = case(f"base.imu={card}", "base.imu.process_rate=10 Hz", "base.filter.strapdown.ratio=1")
    imu = prepared_case.scenario.imu
    assert imu.gyro.flicker == pytest.approx(floor / 0.664, rel=0.05)
    stream = stream_at_rest(prepared_case, 0, imu, n, 5)[:, :3]
    factors = [100, 200, 400]
    made, logged = (overlapping(one, dt, factors) for one in (stream, frame.iloc[:, [1, 3, 5]].to_numpy()))
    # three axes of 150 intervals of the longest time: 5 % a deviation
    for one in (made, logged):
        np.testing.assert_allclose(np.sqrt(np.mean(one**2, axis=1)), floor, rtol=0.1)
    printed = next(line for line in found.text.splitlines() if "floor of the Allan deviation" in line)
    values = [float(number) for number in printed.partition(": ")[2].removesuffix(" deg/h").split(";")]
    np.testing.assert_allclose(values, 14.5, rtol=0.1)
