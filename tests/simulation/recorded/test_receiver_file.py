"""Solutions of a log: rows that cannot be true are left out and counted, columns that cannot be true are refused."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.receiver_file import MOTION, PLACE, SIGMAS, ReceiverFile, Solutions, read_solutions

ROW, RATE, SIGMA_P, SIGMA_V = 150, 4.0, 0.3, 0.05


@pytest.fixture(scope="module")
def drive() -> pd.DataFrame:
    """A drive of eights at 500 m, 47 deg north, 9 deg east after a rest of 20 s: its motion in closed form."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 100.0, 1.0 / RATE)
    on = np.clip(t - 20.0, 0.0, None)
    east, north = 60.0 * np.sin(0.12 * on), 30.0 * np.sin(0.24 * on)
    moves = (t > 20.0).astype(float)
    metre = np.degrees(1.0 / 6.378e6)
    noise = rng.standard_normal((t.size, 6))
    lat = 47.0 + metre * 1.0015 * (north + SIGMA_P * noise[:, 0])
    lon = 9.0 + metre / np.cos(np.radians(47.0)) * 0.9982 * (east + SIGMA_P * noise[:, 1])
    velocity = np.stack([7.2 * np.cos(0.24 * on) * moves, 7.2 * np.cos(0.12 * on) * moves, 0.0 * t], axis=1)
    velocity += SIGMA_V * noise[:, 3:]
    frame = pd.DataFrame({"t_s": 1000.0 + t, "latitude_deg": lat, "longitude_deg": lon})
    frame["height_m"] = 500.0 + SIGMA_P * noise[:, 2]
    frame[list(MOTION)] = velocity
    frame[list(SIGMAS)] = np.repeat([SIGMA_P, SIGMA_V], 3)
    return frame


def found(frame: pd.DataFrame, folder, noise: str = "filter") -> Solutions:
    frame.to_csv(folder / "gnss.csv", index=False)
    return read_solutions(ReceiverFile(file="gnss.csv", noise=noise), folder)


def in_row(frame: pd.DataFrame, names, values) -> pd.DataFrame:
    frame = frame.copy()
    frame.loc[ROW, list(names)] = values
    return frame


@pytest.mark.parametrize("noise", ["filter", "log"])
def test_a_log_without_faults_is_whole_and_nothing_is_said(drive, tmp_path, noise):
    log = found(drive, tmp_path, noise)
    assert log.t.size == len(drive)
    assert log.notes == ()


@pytest.mark.parametrize(
    ("names", "values", "said"),
    [
        ((*PLACE, *MOTION), 0.0, "are at latitude and longitude zero, as of a receiver without a fix"),
        (PLACE[:2], [9.0, 47.0], r"contradict the positions and velocities of the rows around them, by up to \d+ km"),
        (PLACE[:1], 47.01, "contradict the positions and velocities .* by up to 1.1"),
        (PLACE[2:], 0.0, "contradict the positions and velocities .* by up to 500 m"),
        (MOTION[:1], 3000.0, "contradict the positions and velocities"),
        (MOTION[1:2], np.nan, "have an empty field"),
        (PLACE[:1], np.nan, "have an empty field"),
    ],
)
def test_a_single_row_that_cannot_be_true_is_left_out_with_its_line(drive, tmp_path, names, values, said):
    log = found(in_row(drive, names, values), tmp_path)
    assert log.t.size == len(drive) - 1
    assert 1000.0 + ROW / RATE not in log.t
    (note,) = log.notes
    assert note.startswith(f"1 of {len(drive)} solutions ")
    assert note.endswith(f"left out (gnss.csv:{ROW + 2})")
    assert pd.Series([note]).str.contains(said).all()


def test_the_first_row_of_the_file_is_time_zero_even_if_it_is_left_out(drive, tmp_path):
    log = found(drive.assign(latitude_deg=drive.latitude_deg.where(drive.index > 2)), tmp_path)
    assert (log.zero, log.t[0]) == (1000.0, 1000.75)


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda f: {"v_north_m_s": f.v_east_m_s, "v_east_m_s": f.v_north_m_s}, "v_north_m_s and v_east_m_s exchanged"),
        (lambda f: {name: 3.6 * f[name] for name in MOTION}, "velocities in km/h"),
        (lambda f: {name: f[name] / 0.514444 for name in MOTION}, "velocities in knots"),
        (lambda f: {name: -f[name] for name in MOTION}, "velocities of the opposite sign"),
        (lambda f: {"longitude_deg": -f.longitude_deg}, "longitude_deg counted to the west"),
        (
            lambda f: {"latitude_deg": f.longitude_deg, "longitude_deg": f.latitude_deg},
            "latitude_deg and longitude_deg",
        ),
        (lambda f: {name: 0.0 * f[name] for name in MOTION}, "is a unit, an axis or a time wrong"),
    ],
)
def test_a_column_that_contradicts_another_is_refused_with_what_it_may_be(drive, tmp_path, change, hint):
    with pytest.raises(InputError, match=f"gnss.csv: .*contradict.*{hint}"):
        found(drive.assign(**change(drive)), tmp_path)


def test_a_climb_that_is_counted_downwards_is_refused(drive, tmp_path):
    t = drive.t_s - 1000.0
    up = drive.assign(height_m=drive.height_m + 8.0 * t, v_down_m_s=drive.v_down_m_s + 8.0)
    with pytest.raises(InputError, match=r"contradict.*v_down_m_s counted upwards"):
        found(up, tmp_path)
    assert found(up.assign(v_down_m_s=drive.v_down_m_s - 8.0), tmp_path).notes == ()


def test_a_log_that_jumps_for_good_is_refused_at_the_row(drive, tmp_path):
    with pytest.raises(InputError, match=rf"gnss.csv:{ROW + 2}: the position is not where .* by up to 1.1"):
        found(drive.assign(latitude_deg=drive.latitude_deg + 0.01 * (drive.index >= ROW)), tmp_path)


@pytest.mark.parametrize("name", SIGMAS)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, 4294967.295])
def test_a_sigma_that_is_none_leaves_out_its_row_and_a_column_of_them_is_refused(drive, tmp_path, name, value):
    one = in_row(drive, [name], value)
    log = found(one, tmp_path, "log")
    assert log.t.size == len(drive) - 1
    assert f"1 of {len(drive)} solutions have a sigma that is not above zero" in log.notes[0]
    assert found(one, tmp_path).t.size == len(drive)  # the filter's card is used
    with pytest.raises(InputError, match=rf"gnss.csv:2: {name} is .*; a sigma is from"):
        found(drive.assign(**{name: value}), tmp_path, "log")


def test_sigmas_that_are_none_and_not_used_are_said(drive, tmp_path):
    assert (
        "sigmas of 1 of 400 solutions are not above zero; they are not used"
        in found(in_row(drive, SIGMAS, -1.0), tmp_path).notes
    )


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("latitude_deg", 91.0, "latitude_deg is 91, beyond 90"),
        ("longitude_deg", -400.0, "longitude_deg is -400, beyond -360"),
        ("height_m", -9999.0, "height_m is -9999, beyond -2000"),
        ("v_down_m_s", 1e6, "a speed of 1e"),
    ],
)
def test_a_number_that_no_vehicle_has_is_refused_at_its_line(drive, tmp_path, name, value, said):
    with pytest.raises(InputError, match=rf"gnss.csv:{ROW + 2}: {said}"):
        found(in_row(drive, [name], value), tmp_path)
