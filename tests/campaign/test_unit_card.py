"""The card that a log gives: read again as a unit, intervals as comments, what it cannot show left out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.unit_card import fit_unit
from lvnav_trade.errors import InputError

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
