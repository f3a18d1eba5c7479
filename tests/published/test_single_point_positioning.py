"""Positions from recorded pseudoranges and broadcast ephemerides, against the surveyed mark."""

import math

import numpy as np
import pytest

from lvnav_trade.gnss.broadcast import broadcast_ephemerides
from lvnav_trade.gnss.rinex import read_navigation
from lvnav_trade.gnss.satellites import nearest_records
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import geodetic_from_ecef, rotation_e_n
from tests.trajectory.products import read_observations

MASK = math.radians(10.0)


def klobuchar(alpha, beta, second, latitude, longitude, azimuth, elevation):
    """Return the delay on L1 (m) of IS-GPS-200, 20.3.3.5.2.5; angles in rad, `second` of the day of GPS time."""
    reach = 0.0137 / (elevation / np.pi + 0.11) - 0.022
    pierce = np.clip(latitude / np.pi + reach * np.cos(azimuth), -0.416, 0.416)
    meridian = longitude / np.pi + reach * np.sin(azimuth) / np.cos(pierce * np.pi)
    magnetic = pierce + 0.064 * np.cos((meridian - 1.617) * np.pi)
    local = np.mod(43200.0 * meridian + second, 86400.0)
    slant = 1.0 + 16.0 * (0.53 - elevation / np.pi) ** 3
    amplitude = np.maximum(sum(a * magnetic**k for k, a in enumerate(alpha)), 0.0)
    period = np.maximum(sum(b * magnetic**k for k, b in enumerate(beta)), 72000.0)
    x = 2.0 * np.pi * (local - 50400.0) / period
    day = amplitude * (1.0 - x**2 / 2.0 + x**4 / 24.0)
    return SPEED_OF_LIGHT * slant * (5e-9 + np.where(np.abs(x) < 1.57, day, 0.0))


def saastamoinen(latitude, height, elevation):
    """Return the delay (m) in a standard atmosphere of half humidity."""
    pressure = 1013.25 * (1.0 - 2.2557e-5 * height) ** 5.2568
    temperature = 288.16 - 6.5e-3 * height
    vapour = 0.5 * 6.108 * math.exp((17.15 * temperature - 4684.0) / (temperature - 38.45))
    sine = np.sin(elevation)
    dry = 0.0022768 * pressure / (1.0 - 0.00266 * math.cos(2.0 * latitude) - 0.00028 * height / 1e3) / sine
    return dry + 0.002277 * (1255.0 / temperature + 0.05) * vapour / sine


def position(time, ranges, navigation):
    """Return the position (m, Earth-fixed) by least squares from the ranges of one epoch, weights sin^2(elevation)."""
    near = nearest_records(navigation.ephemerides, time)
    names = [
        name for name in ranges if name in near and near[name].health == 0.0 and abs(near[name].toe - time) <= 7200.0
    ]
    above, measured = (
        broadcast_ephemerides([near[name] for name in names], time),
        np.array([ranges[name] for name in names]),
    )
    sent = -measured / SPEED_OF_LIGHT  # s since `time`, by the satellites' clocks
    ahead = above.clock(sent) + above.relativity(sent) - above.elements["group_delay"]
    sent = sent - ahead
    r_sat, _ = above.ecef(sent)
    state = np.zeros(4)
    for turn in range(10):
        travel = np.linalg.norm(r_sat - state[:3], axis=1) / SPEED_OF_LIGHT if turn else np.full(len(names), 0.075)
        c, s = np.cos(OMEGA * travel), np.sin(OMEGA * travel)
        x, y, z = r_sat.T
        line = np.stack([c * x + s * y, -s * x + c * y, z], axis=1) - state[:3]
        distance = np.linalg.norm(line, axis=1)
        unit = line / distance[:, None]
        delay, weight, used = np.zeros(len(names)), np.ones(len(names)), np.ones(len(names), dtype=bool)
        if turn > 4:  # near enough for angles
            latitude, longitude, height = (float(q) for q in geodetic_from_ecef(state[:3]))
            north, east, down = rotation_e_n(latitude, longitude) @ unit.T
            azimuth, elevation = np.arctan2(east, north), np.arcsin(-down)
            weight, used = np.sin(elevation), elevation >= MASK
            delay = saastamoinen(latitude, height, elevation)
            delay += klobuchar(*navigation.klobuchar, time % 86400.0, latitude, longitude, azimuth, elevation)
        lacking = measured + SPEED_OF_LIGHT * ahead - distance - state[3] - delay
        rows = np.column_stack([-unit, np.ones(len(names))])
        root = weight[used]
        step = np.linalg.lstsq(rows[used] * root[:, None], lacking[used] * root, rcond=None)[0]
        state += step
    assert np.linalg.norm(step) < 1e-3
    return state[:3]


def test_single_point_positions_of_a_recorded_hour_have_the_published_mean_deviation_and_rms(refdata, record_property):
    navigation = read_navigation(refdata / "gnss/spp_obs/07590920.05n")
    epochs, mark = read_observations(refdata / "gnss/spp_obs/07590920.05o", "C1")
    assert len(epochs) == 120
    latitude, longitude, _ = (float(q) for q in geodetic_from_ecef(mark))
    error = np.array([position(time, ranges, navigation) - mark for time, ranges in epochs.items()])
    north, east, down = rotation_e_n(latitude, longitude) @ error.T
    local = np.stack([east, north, -down])
    rms = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    record_property(
        "single-point positioning: mean, deviation (east, north, up) and 3-D RMS in m",
        [*np.round(np.concatenate([local.mean(axis=1), local.std(axis=1), [rms]]), 3).tolist()],
    )
    assert local.mean(axis=1) == pytest.approx([-0.25, -0.11, -0.31], abs=0.006)
    assert local.std(axis=1) == pytest.approx([0.30, 0.27, 0.76], abs=0.006)
    assert rms == pytest.approx(0.96, abs=0.006)
