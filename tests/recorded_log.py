"""Logs of a vehicle whose true motion is known: it rests, then drives eights; unit and receiver have known errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.gnss.satellites import satellites
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    ecef_from_geodetic,
    eci_from_ecef,
    geodetic_from_ecef,
    gmst,
    quaternions,
    rotation_i_n,
)
from lvnav_trade.quantities.records import Reference
from lvnav_trade.quantities.times import utc_after
from lvnav_trade.trajectory.truth import Phase, Trajectory, attitude_spline, position_spline, reference

EPOCH = "2026-06-01T10:00:00+00:00"
PLACE = np.array([np.radians(47.0), np.radians(9.0), 500.0])
REST, RATE, FIXES = 20.0, 100.0, 4.0
ARW, VRW = 3e-5, 3e-4  # rad/sqrt(s), m/s/sqrt(s)
GYRO_BIAS, ACCEL_BIAS = np.array([2e-4, -3e-4, 1e-4]), np.array([0.004, -0.003, 0.002])  # rad/s, m/s^2
SIGMA_P, SIGMA_V = 0.3, 0.05
SIGMA_RANGE, SIGMA_RATE = 1.0, 0.05

CAMPAIGN = f"""\
name: drive
seed: 1
base:
  trajectory: trajectories/two_stage_leo
  imu: {{card: imu/tactical_mems, rate: "{RATE:g} Hz"}}
  constellation: constellations/gps_24
  receiver: {{card: receivers/l1_two_metre, rate: "{FIXES:g} Hz"}}
  filter:
    card: filters/loose
    update_rate: "{FIXES:g} Hz"
    covariance_rate: "20 Hz"
    imu:
      gyro_random_walk: "{ARW} rad/sqrt(s)"
      accel_random_walk: "{VRW} m/s/sqrt(s)"
      gyro_bias: "5e-5 rad/s"
      gyro_bias_walk: "1e-7 rad/s/sqrt(s)"
      accel_bias: "5e-3 m/s**2"
      accel_bias_walk: "1e-6 m/s**2/sqrt(s)"
    receiver: {{pseudorange_sigma: "{SIGMA_RANGE} m", range_rate_sigma: "{SIGMA_RATE} m/s",
      position_sigma: "{SIGMA_P} m", velocity_sigma: "{SIGMA_V} m/s", clock_h0: 0, clock_h_minus2: 0}}
  initial: {{tilt: "0.05 deg", heading: "2 deg", position: "{SIGMA_P} m", velocity: "{SIGMA_V} m/s"}}
"""


def driven(seconds: float = 140.0) -> tuple[Trajectory, Reference]:
    """Return the true motion, and its samples at `RATE`; time zero is the begin of the rest."""
    theta0 = gmst(EPOCH)
    t = np.arange(0.0, seconds + 1e-9, 0.25)
    on = np.clip(t - REST, 0.0, None)
    ramp = on**3 / (on**2 + 16.0)  # from rest to a steady run
    east, north = 60.0 * np.sin(0.12 * ramp), 30.0 * np.sin(0.24 * ramp)
    r_0 = ecef_from_geodetic(*PLACE)
    lat, lon = PLACE[:2]
    e = np.array([-np.sin(lon), np.cos(lon), 0.0])
    n = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    r_i = eci_from_ecef(r_0 + np.outer(east, e) + np.outer(north, n), earth_angle(theta0, t))
    fine = position_spline(t, r_i, np.gradient(r_i, t, axis=0)[[0, -1]], np.zeros((2, 3)))
    course = np.unwrap(np.arctan2(np.gradient(east, t), np.gradient(north, t) + 1e-12))
    course[t <= REST + 1.0] = course[np.argmax(t > REST + 1.0)]
    C_i_n = rotation_i_n(r_i, earth_angle(theta0, t))
    c, s = np.cos(course), np.sin(course)
    zero, one = np.zeros_like(c), np.ones_like(c)
    C_b_n = np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]), 2, 0)
    q = quaternions(np.swapaxes(C_i_n, 1, 2) @ C_b_n)
    flight = Trajectory((Phase("drive", 0.0, float(t[-1]), fine, attitude_spline(t, q)),), {}, theta0, EPOCH)
    return flight, reference(flight, RATE)


def write(
    folder: Path, seed: int = 1, uneven: bool = False, turned: bool = False, ranges: bool = False
) -> tuple[Path, Reference]:
    """Write a log and its card into a folder; return the card, and the truth."""
    _, ref = driven()
    rng = np.random.default_rng(seed)
    dt, n = 1.0 / RATE, len(ref.dtheta)
    dtheta = ref.dtheta + GYRO_BIAS * dt + ARW * np.sqrt(dt) * rng.standard_normal((n, 3))
    dvel = ref.dvel + ACCEL_BIAS * dt + VRW * np.sqrt(dt) * rng.standard_normal((n, 3))
    if turned:  # log axes: x forward, y left, z up
        dtheta, dvel = dtheta * [1.0, -1.0, -1.0], dvel * [1.0, -1.0, -1.0]
    t = ref.t[1:]
    unit = pd.DataFrame({"t_s": 1000.0 + t, **{f"gyro_{a}_rad": dtheta[:, k] for k, a in enumerate("xyz")},
                         **{f"accel_{a}_m_s": dvel[:, k] for k, a in enumerate("xyz")}})  # fmt: skip
    if uneven:  # every seventh row is put together with the next
        together = np.arange(3, n - 1, 7)
        values = unit.to_numpy(copy=True)
        values[together + 1, 1:] += values[together, 1:]
        unit = pd.DataFrame(np.delete(values, together, axis=0), columns=unit.columns)
    unit.to_csv(folder / "imu.csv", index=False)
    at = np.arange(0, n + 1, round(RATE / FIXES))
    theta = earth_angle(gmst(EPOCH), ref.t[at])
    r_e = ecef_from_eci(ref.r_i[at], theta) + SIGMA_P * rng.standard_normal((at.size, 3))
    v_n = np.einsum("nij,nj->ni", rotation_i_n(ref.r_i[at], theta), earth_velocity(ref.r_i[at], ref.v_i[at]))
    v_n = v_n + SIGMA_V * rng.standard_normal((at.size, 3))
    lat, lon, height = geodetic_from_ecef(r_e)
    pd.DataFrame({
        "t_s": 1000.0 + ref.t[at], "height_m": height,
        "latitude_deg": np.degrees(lat), "longitude_deg": np.degrees(lon),
        "v_north_m_s": v_n[:, 0], "v_east_m_s": v_n[:, 1], "v_down_m_s": v_n[:, 2],
        **{f"sigma_{axis}_m": SIGMA_P for axis in ("north", "east", "down")},
        **{f"sigma_v_{axis}_m_s": SIGMA_V for axis in ("north", "east", "down")},
    }).to_csv(folder / "gnss.csv", index=False)  # fmt: skip
    axes = "[x, -y, -z]" if turned else "[x, y, z]"
    card = folder / "log.yaml"
    card.write_text(
        f'name: drive\nsource: simulated\nepoch: "2026-06-01T09:43:20+00:00"\nimu: {{file: imu.csv, axes: {axes}}}\n'
        'gnss: {file: gnss.csv}\nstill: ["0 s", "20 s"]\n'
    )
    (folder / "drive.yaml").write_text(CAMPAIGN)
    if ranges:
        card.write_text(card.read_text() + "ranges: {file: ranges.csv}\n")
        _write_ranges(folder, ref, at, rng)
    return card, ref


def _write_ranges(folder: Path, ref: Reference, at: np.ndarray, rng: np.random.Generator) -> None:
    """Write pseudoranges and range rates to the nominal satellites, of a receiver whose clock is off and drifts."""
    flown = load(folder / "drive.yaml").base
    above = satellites(flown.constellation, utc_after(EPOCH, REST))
    theta0, rows = gmst(EPOCH), []
    for k in at[ref.t[at] >= REST].tolist():
        t = ref.t[k]
        r_s, travel = np.zeros((len(above.names), 3)), np.full(len(above.names), 0.075)
        r_e = ecef_from_eci(ref.r_i[k], earth_angle(theta0, t))
        v_e = ecef_from_eci(earth_velocity(ref.r_i[k], ref.v_i[k]), earth_angle(theta0, t))
        for _ in range(5):
            r_s, v_s = _turned_back(above.ecef(t - REST - travel), travel)
            travel = np.linalg.norm(r_s - r_e, axis=1) / SPEED_OF_LIGHT
        towards = (r_s - r_e) / np.linalg.norm(r_s - r_e, axis=1)[:, None]
        up = r_e / np.linalg.norm(r_e)
        rate = np.einsum("ij,ij->i", towards, v_s - v_e)
        rate = rate / (1.0 + np.einsum("ij,ij->i", towards, v_s) / SPEED_OF_LIGHT)
        for s in np.flatnonzero(towards @ up > np.sin(np.radians(8.0))).tolist():
            noise = rng.standard_normal(2)
            pseudorange = SPEED_OF_LIGHT * travel[s] + 5e4 + 30.0 * t + SIGMA_RANGE * noise[0]
            rows.append((1000.0 + t, above.names[s], pseudorange, rate[s] + 30.0 + SIGMA_RATE * noise[1]))
    columns = ["t_s", "satellite", "pseudorange_m", "range_rate_m_s"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "ranges.csv", index=False, float_format="%.13g")


def _turned_back(state: tuple[np.ndarray, np.ndarray], travel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (n_sat, 3) in the Earth-fixed axes of reception; velocities without the turn of
    the axes meanwhile, some 5 mm/s of a range rate.
    """
    c, s = np.cos(OMEGA * travel), np.sin(OMEGA * travel)
    return tuple(np.stack([c * a[:, 0] + s * a[:, 1], c * a[:, 1] - s * a[:, 0], a[:, 2]], axis=1) for a in state)
