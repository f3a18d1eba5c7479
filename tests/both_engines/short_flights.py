"""Flights of the combination matrix: a minute of boost and coast, or from the pad."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, quaternions, rotation_e_n
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.attitude_algebra import body_axes
from lvnav_trade.trajectory.disturbances import OscillationCard, oscillations
from lvnav_trade.trajectory.flight import Phase, Trajectory
from lvnav_trade.trajectory.truth import add_oscillations, attitude_spline, pad_phase, pad_times, position_spline
from tests.building import SITE_R, SITE_V, fly

FROM_PAD = "from the pad, "
STEADY = ", steady thrust"


@lru_cache(maxsize=4)
def flight(kind: str) -> Trajectory:
    """Return a minute of flight: 40 s of boost, then coast; the body pitches slowly, and spins or oscillates. Of a kind
    that ends with STEADY the boost goes on.
    """
    if kind.startswith(FROM_PAD):
        return _from_pad(kind.removeprefix(FROM_PAD))
    along = 30.0 * SITE_V / np.linalg.norm(SITE_V)
    coast = along if kind.endswith(STEADY) else np.zeros(3)
    phases, events, start, r, v = [], {"liftoff": 0.0}, 0.0, SITE_R, SITE_V
    for number, (duration, force) in enumerate(((40.0, along), (20.0, coast))):
        t = start + np.linspace(0.0, duration, int(40 * duration) + 1)
        rs, vs, accelerations = fly(lambda _, f=force: f, t, r, v)
        position = position_spline(t, rs, vs[[0, -1]], accelerations[[0, -1]])
        attitude = attitude_spline(t, _attitude(kind.removesuffix(STEADY), t))
        phases.append(Phase(f"phase{number}", t[0], t[-1], position, attitude))
        start, r, v = t[-1], rs[-1], vs[-1]
        events[("stage1_cutoff", "end")[number]] = start
    return Trajectory(tuple(phases), events, 0.3, "2024-03-20T12:00:00Z")


def _from_pad(kind: str) -> Trajectory:
    """Return half a minute on the pad at 40 N, where the vehicle sways if it oscillates, and half a minute of flight
    straight up, in which it spins if it does.
    """
    r_e, lift_off = ecef_from_geodetic(np.radians(40.0), np.radians(-75.0), 30.0), 30.0
    _, east, down = rotation_e_n(np.radians(40.0), np.radians(-75.0))

    def upright(t: Floats) -> Floats:
        x, side = (eci_from_ecef(np.tile(axis, (t.size, 1)), earth_angle(0.3, t)) for axis in (-down, east))
        # the spin builds up in five seconds: at once, it would be 5 m/s of a lever arm's speed that nothing expects
        since = np.maximum(0.0, t - lift_off)
        turned = np.where(since < 5.0, 0.1 * since**2, since - 2.5)
        roll = 2.0 * np.pi * 0.8 * turned if kind == "spinning" else np.zeros(t.size)
        return quaternions(body_axes(x, side, roll))

    before = pad_times(lift_off, lift_off)
    pad = pad_phase(r_e, 0.3, lift_off, lift_off, attitude_spline(before, upright(before)))
    t = lift_off + np.linspace(0.0, 30.0, 1201)
    up = eci_from_ecef(-down, earth_angle(0.3, lift_off))
    r, v, a = fly(lambda _: 25.0 * up, t, pad[0].position(lift_off), pad[0].position(lift_off, 1))
    flown = Phase("ascent", t[0], t[-1], position_spline(t, r, v[[0, -1]], a[[0, -1]]), attitude_spline(t, upright(t)))
    events = {"liftoff": lift_off, "stage1_cutoff": 45.0, "end": 60.0}
    nominal = Trajectory((*pad, flown), events, 0.3, "2024-03-20T12:00:00Z")
    if kind != "oscillating":
        return nominal
    sway = {"frequency": "0.5 Hz", "axis": "y", "angle": "0.3 mrad", "lever": ["20 m", "0 m", "0 m"], "damping": 0.05}
    card = OscillationCard.model_validate({"start": "0 s", "end": "liftoff", "modes": [sway]})
    return add_oscillations(nominal, oscillations([card], events, (0.0, 60.0)))


def _attitude(kind: str, t: Floats) -> Floats:
    x = SITE_V / np.linalg.norm(SITE_V)
    z = np.cross(x, SITE_R)
    z /= np.linalg.norm(z)
    y = np.cross(z, x)
    pitch = np.radians(0.5) * t
    roll = (2.0 * np.pi * 0.8 if kind == "spinning" else np.radians(2.0)) * t
    if kind == "oscillating":
        pitch = pitch + np.radians(1.0) * np.sin(2.0 * np.pi * 1.2 * t)
    nose = np.cos(pitch)[:, None] * x + np.sin(pitch)[:, None] * y
    side = np.cos(pitch)[:, None] * y - np.sin(pitch)[:, None] * x
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return quaternions(np.stack([nose, c * side + s * z, c * z - s * side], axis=-1))
