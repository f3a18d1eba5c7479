"""Clock, inertial axes and attitude of a file are compared with what a vehicle at rest and its forces show."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.guesses import guess
from lvnav_trade.trajectory.files.j2000 import rotation_to_date
from lvnav_trade.trajectory.files.row_checks import rounding
from lvnav_trade.trajectory.files.rows import read_rows
from lvnav_trade.trajectory.flight import build
from lvnav_trade.trajectory.truth import NOTE, WARNING
from tests.trajectory.tables import card, example_settings

GEODETIC = ["latitude_deg", "longitude_deg", "height_m"]
NED = ["north_m_s", "east_m_s", "down_m_s"]
AXES = ["x_j2000 [km]", "y_j2000 [km]", "z_j2000 [km]", "vx_j2000 [km/s]", "vy_j2000 [km/s]", "vz_j2000 [km/s]"]


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return pd.read_csv(example_settings()["file"], comment="#")


def own(tmp_path, table: pd.DataFrame, **fields):
    """The example's card of other rows, as settings."""
    table.to_csv(tmp_path / "mine.csv", index=False)
    return card({**example_settings(), "file": str(tmp_path / "mine.csv")}, **fields)


def said(trajectory, kind: str) -> list[str]:
    return [remark.text for remark in trajectory.remarks if remark.category == kind]


def in_j2000(rows: pd.DataFrame, epoch: str) -> pd.DataFrame:
    """The rows with position and velocity along axes of J2000, km and km/s."""
    theta = frames.gmst(epoch) + OMEGA * rows.time_s.to_numpy()
    latitude, longitude = np.radians(rows[GEODETIC[:2]].to_numpy()).T
    r_e = frames.ecef_from_geodetic(latitude, longitude, rows.height_m.to_numpy())
    v_e = np.einsum("kji,kj->ki", frames.rotation_e_n(latitude, longitude), rows[NED].to_numpy())
    v_e += np.cross([0.0, 0.0, OMEGA], r_e)
    turned = [frames.eci_from_ecef(one, theta) @ rotation_to_date(epoch) / 1e3 for one in (r_e, v_e)]
    return rows[["time_s"]].assign(**dict(zip(AXES, np.hstack(turned).T, strict=True)))


def test_columns_of_j2000_are_the_flight_in_axes_of_date(tmp_path, rows) -> None:
    epoch = example_settings()["epoch"]
    in_j2000(rows, epoch).to_csv(tmp_path / "mine.csv", index=False)
    found = {one.field: one.content for one in guess(str(tmp_path / "mine.csv"))}
    assert (found["position"]["frame"], found["velocity"]["frame"]) == ("j2000", "j2000")
    settings = {**example_settings(), "file": str(tmp_path / "mine.csv"), **found}
    settings.pop("attitude")
    turned, plain = read_rows(card(settings)), read_rows(card(example_settings()))
    assert np.max(np.abs(turned.r_i - plain.r_i)) < 1e-3
    assert np.max(np.abs(turned.v_i - plain.v_i)) < 1e-6
    wrong = {part: {**found[part], "frame": "eci"} for part in ("position", "velocity")}
    flight = build(card({**settings, **wrong, "pad_hold": "0 s"}))
    (line,) = [one for one in said(flight, WARNING) if "first row" in one]
    assert line.startswith("the first row moves at 1.")
    assert "in frame j2000: are the axes those?" in line


def test_an_angle_to_greenwich_has_no_meaning_without_columns_of_frame_eci() -> None:
    with pytest.raises(ValueError, match="greenwich is the angle of frame eci, and no columns are in it"):
        card({**example_settings(), "attitude": None}, greenwich="10 deg")


@pytest.mark.parametrize(("shift", "refused"), [(124_218.0, True), (20.0, False)])
def test_a_clock_that_counts_from_elsewhere_is_refused_or_warned_of(
    tmp_path, rows, shift: float, refused: bool
) -> None:
    events = {name: f"{float(text.split()[0]) + shift} s" for name, text in example_settings()["events"].items()}
    shifted = own(tmp_path, rows.assign(time_s=rows.time_s + shift), events=events)
    if refused:
        with pytest.raises(InputError, match=rf"the vehicle rests on the ground until .*liftoff: {shift:.0f}"):
            build(shifted)
        return
    assert any("the vehicle rests on the ground until" in line for line in said(build(shifted), WARNING))


def test_a_flight_that_begins_a_day_after_lift_off_is_refused(tmp_path, rows) -> None:
    late = rows[rows.time_s > 200.0]
    late = late.assign(time_s=late.time_s + 300_000.0)
    with pytest.raises(InputError, match=r"the first row is 83\.4 h from lift-off: state what the column shows"):
        build(own(tmp_path, late, events={}, pad_hold="0 s"))


def test_a_row_that_is_there_twice_is_taken_once_and_said(tmp_path, rows) -> None:
    twice = rows.iloc[np.sort(np.append(np.arange(len(rows)), [0, len(rows) // 2, len(rows) - 1]))]
    flight, plain = build(own(tmp_path, twice)), build(card(example_settings()))
    assert "3 rows equal to the row before left out" in said(flight, NOTE)
    t = np.linspace(0.0, plain.end - 1.0, 50)
    assert np.array_equal(flight.phases[-1].position(t), plain.phases[-1].position(t))


def test_rounding_to_single_precision_is_seen() -> None:
    column = np.random.default_rng(1).uniform(6.3e6, 6.4e6, 500).astype(np.float32).astype(float)
    assert rounding(column) == pytest.approx(0.5 / np.sqrt(12.0))
    assert rounding(np.random.default_rng(1).uniform(6.3e6, 6.4e6, 500)) == 0.0
