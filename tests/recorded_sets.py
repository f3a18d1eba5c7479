"""Recorded sets of others as logs of the tool's own form. They are not part of the project; tests that need them skip.

``python -m tests.recorded_sets SHARED DIR`` writes the logs and their cards into a folder.
"""

from __future__ import annotations

import sys
from calendar import timegm
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import loadmat

from lvnav_trade.gnss.broadcast import BroadcastEphemerides, broadcast_ephemerides
from lvnav_trade.gnss.rinex import Ephemeris
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import geodetic_from_ecef, rotation_e_n

LIGHT = 299_792_458.0
SHARED = Path(__file__).resolve().parents[2] / "shared" / "refdata" / "imu_gnss"
_WALK = """\
name: a walk of 134 s
source: >-
  rtklibexplorer/GNSS_IMU, walk_0827: ICM45686 at 166 Hz, u-blox F9P with RTK at 4 Hz
epoch: "2025-08-27T23:59:42+00:00"    # its times are those of GPS
imu: {file: walk_imu.csv, axes: [x, -y, -z]}    # the log's z axis points up
gnss: {file: walk_gnss.csv}
still: ["1.5 s", "8 s"]
"""


def walk(folder: Path, shared: Path = SHARED) -> Path:
    """Write the walk: IMU (time s, g, rad/s) and RTK solutions (north, east, up); return its card."""
    source = shared / "rtklibexplorer_walk"
    day = timegm((2025, 8, 28, 0, 0, 0))
    rows = np.loadtxt(source / "walk_imu_1730_sf.csv", delimiter=",")
    names = ["t_s", *(f"accel_{axis}_g" for axis in "xyz"), *(f"gyro_{axis}_rad_s" for axis in "xyz")]
    rows[:, 0] -= day
    pd.DataFrame(rows[:, :7], columns=names).to_csv(folder / "walk_imu.csv", index=False, float_format="%.9g")
    found = []
    for line in (source / "walk_gnss_1730_sf.pos").read_text().splitlines():
        if not line.startswith("%"):
            date, time, *values = line.split()
            at = datetime.strptime(f"{date} {time} +0000", "%Y/%m/%d %H:%M:%S.%f %z").timestamp() - day
            v = [float(value) for value in values]
            found.append([round(at, 3), *v[:3], v[13], v[14], -v[15], v[5], v[6], v[7], *v[16:19]])
    columns = ["t_s", "latitude_deg", "longitude_deg", "height_m", "v_north_m_s", "v_east_m_s", "v_down_m_s"]
    columns += [f"sigma_{axis}_m" for axis in ("north", "east", "down")]
    columns += [f"sigma_v_{axis}_m_s" for axis in ("north", "east", "down")]
    pd.DataFrame(found, columns=columns).to_csv(folder / "walk_gnss.csv", index=False, float_format="%.12g")
    card = folder / "walk_log.yaml"
    card.write_text(_WALK)
    return card


_DRIVE = """\
name: a drive of 136 s
source: >-
  PSINS, insgpseo_tc: 200 Hz, GPS L1 at 1 Hz; solutions are least squares of its pseudoranges and Doppler shifts with
  its broadcast ephemerides
epoch: "2021-11-06T23:59:42+00:00"    # its times are those of GPS
imu: {file: drive_imu.csv, axes: [-x, y, -z]}    # the axes of the log point back, right and up
gnss: {file: drive_gnss.csv}
ranges: {file: drive_ranges.csv}
still: ["1 s", "66 s"]
heading_within: "15 s"
"""
# Columns of the set's ephemerides that the elements of the tool stand in.
_ELEMENTS = {
    "clock_bias": 2, "clock_drift": 3, "clock_drift_rate": 4, "radius_sin": 6, "mean_motion_difference": 7,
    "mean_anomaly": 8, "latitude_cos": 9, "eccentricity": 10, "latitude_sin": 11, "root_axis": 12, "week_second": 13,
    "inclination_cos": 14, "node": 15, "inclination_sin": 16, "inclination": 17, "radius_cos": 18, "perigee": 19,
    "node_rate": 20, "inclination_rate": 21, "group_delay": 27,
}  # fmt: skip


def drive(folder: Path, shared: Path = SHARED) -> Path:
    """Write the drive: increments (rad, m/s) and solutions of its pseudoranges and Doppler shifts; return its card."""
    found = loadmat(shared / "psins" / "insgpseo_tc.mat", squeeze_me=True)
    zero = float(found["t0"])
    names = [*(f"gyro_{axis}_rad" for axis in "xyz"), *(f"accel_{axis}_m_s" for axis in "xyz"), "t_s"]
    rows = pd.DataFrame(found["imu"], columns=names)
    rows.assign(t_s=rows.t_s + zero).to_csv(folder / "drive_imu.csv", index=False, float_format="%.12g")
    fixes = solutions(found["obss"][found["obss"][:, 0] > zero], found["ephs"])
    columns = ["t_s", "latitude_deg", "longitude_deg", "height_m", "v_north_m_s", "v_east_m_s", "v_down_m_s"]
    pd.DataFrame(fixes, columns=columns).to_csv(folder / "drive_gnss.csv", index=False, float_format="%.12g")
    seen = found["obss"][found["obss"][:, 0] > zero]
    ranges = pd.DataFrame({"t_s": seen[:, 0], "satellite": [f"G{int(number):02d}" for number in seen[:, 1]],
                           "pseudorange_m": seen[:, 2], "range_rate_m_s": -seen[:, 5]})  # fmt: skip
    ranges.to_csv(folder / "drive_ranges.csv", index=False, float_format="%.13g")
    (folder / "drive.nav").write_text(rinex(found["ephs"]))
    card = folder / "drive_log.yaml"
    card.write_text(_DRIVE)
    return card


def rinex(stated: np.ndarray) -> str:
    """Return ephemerides of the set as a navigation file of RINEX 2."""
    lines = [f"{'     2.10           NAVIGATION DATA':60}RINEX VERSION / TYPE", f"{'':60}END OF HEADER"]
    for row in np.nan_to_num(stated[stated[:, 12] > 5000.0]):
        at = datetime(2021, 11, 7) + timedelta(seconds=float(row[1]))
        values = [
            row[2:5],
            row[5:9],
            row[9:13],
            row[13:17],
            row[17:21],
            row[21:25],
            row[25:29],
            [*row[29:31], 0.0, 0.0],
        ]
        for number, part in enumerate(values):
            head = f"{int(row[0]):2d} {at:%y %m %d %H %M} {at.second:4.1f}" if number == 0 else "   "
            lines.append(head + "".join(f"{value:19.12E}".replace("E", "D") for value in part))
    return "\n".join(lines) + "\n"


def solutions(observed: np.ndarray, stated: np.ndarray) -> list[list[float]]:
    """Return time, latitude, longitude (deg), height, velocity north, east, down of every epoch with five satellites.

    observed: rows of time of week (s), satellite, pseudorange (m), the same less the satellite's clock, -, -range rate
    (m/s); stated: ephemerides. The ionosphere is left in: its error hardly changes within minutes.
    """
    used = stated[stated[:, 12] > 5000.0]
    every = [
        Ephemeris(f"G{int(row[0]):02d}", row[1], row[13], 0.0, {k: row[at] for k, at in _ELEMENTS.items()})
        for row in used
    ]
    sky = broadcast_ephemerides(every, 0.0)
    place, found = np.zeros(3), []
    for tow in np.unique(observed[:, 0]):
        rows = observed[observed[:, 0] == tow]
        at = [sky.names.index(f"G{int(number):02d}") for number in rows[:, 1] if f"G{int(number):02d}" in sky.names]
        rows = rows[[f"G{int(number):02d}" in sky.names for number in rows[:, 1]]]
        if len(rows) < 5:
            continue
        fix = _solved(sky, at, tow, rows, place)
        place = fix[0]
        latitude, longitude, height = (float(value) for value in geodetic_from_ecef(fix[0]))
        found.append([tow, *np.degrees([latitude, longitude]), height, *(rotation_e_n(latitude, longitude) @ fix[1])])
    return found


def _solved(
    sky: BroadcastEphemerides, at: list[int], tow: float, rows: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return position and velocity, frame e, by least squares of ranges and range rates."""
    place, bias = start.copy(), 0.0
    ranges = rows[:, 2]
    for _ in range(8):
        sent = tow - ranges / LIGHT
        clock = np.array([sky.clock(t)[k] + sky.relativity(t)[k] for t, k in zip(sent, at, strict=True)])
        r_e, v_e = (np.array([sky.ecef(np.array(t))[part][k] for t, k in zip(sent - clock, at, strict=True)])
                    for part in (0, 1))  # fmt: skip
        angle = OMEGA * ((ranges - bias) / LIGHT + clock)
        c, s = np.cos(angle), np.sin(angle)
        r_e, v_e = (np.stack([c * a[:, 0] + s * a[:, 1], c * a[:, 1] - s * a[:, 0], a[:, 2]], 1) for a in (r_e, v_e))
        line = r_e - place
        distance = np.linalg.norm(line, axis=1)
        towards = line / distance[:, None]
        air = np.zeros(len(rows))
        if np.linalg.norm(place) > 6e6:
            air = 2.4 / np.maximum(0.1, towards @ (place / np.linalg.norm(place)))
        design = np.column_stack([-towards, np.ones(len(rows))])
        step = np.linalg.lstsq(design, ranges + LIGHT * clock - air - distance - bias)[0]
        place, bias = place + step[:3], bias + step[3]
    drift = np.array([sky.elements["clock_drift"][k] for k in at])
    # the Earth-fixed axes turn while the signal travels
    rate = np.einsum("ij,ij->i", towards, v_e + np.cross([0.0, 0.0, OMEGA], r_e) - np.cross([0.0, 0.0, OMEGA], place))
    velocity = np.linalg.lstsq(design, -rows[:, 5] + LIGHT * drift - rate)[0]
    return place, velocity[:3]


if __name__ == "__main__":
    for make in (walk, drive):
        make(Path(sys.argv[2]), Path(sys.argv[1]))
