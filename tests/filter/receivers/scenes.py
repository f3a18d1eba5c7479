"""Satellites and motions for receivers: circular orbits, a receiver that stands or ascends, and its measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.bancroft import solution
from lvnav_trade.filter.receivers.ekf_gnss import step
from lvnav_trade.filter.receivers.receiver import new_receiver, switch_on
from lvnav_trade.kernels.earth import GM, OMEGA
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, sqrt, view
from lvnav_trade.kernels.vector import WIDTH

RADIUS, ORBIT = 6.378e6, 26.56e6


class Scene(NamedTuple):
    """t (n,); r_i, v_i (n, 3); satellite, moving (n, n_sat, 3); used (n, n_sat) int; n_used (n,)."""

    t: np.ndarray
    r_i: np.ndarray
    v_i: np.ndarray
    satellite: np.ndarray
    moving: np.ndarray
    used: np.ndarray
    n_used: np.ndarray


def standing(t):
    """A place on the equator that turns with the Earth."""
    c, s = np.cos(OMEGA * t), np.sin(OMEGA * t)
    r_i = RADIUS * np.stack([c, s, 0.0 * t], axis=1)
    return r_i, OMEGA * np.stack([-r_i[:, 1], r_i[:, 0], 0.0 * t], axis=1)


def ascending(t, burn=150.0):
    """From the same place at t = 0 on: thrust, tilted to the east, that grows to 6 g until `burn`, then none."""
    r_i, v_i = standing(t)
    n_fine = 100
    for k in range(1, len(t)):
        if t[k] <= 0.0:
            continue
        r, v, dt = r_i[k - 1].copy(), v_i[k - 1].copy(), (t[k] - t[k - 1]) / n_fine
        for fine in range(n_fine):
            at = t[k - 1] + (fine + 0.5) * dt
            up = r / np.linalg.norm(r)
            thrust = (13.0 + 46.0 * at / burn) * (np.array([0.6, 0.75, 0.28])) if 0.0 < at < burn else np.zeros(3)
            a = thrust - GM * up / (r @ r)
            r, v = r + dt * v + 0.5 * dt * dt * a, v + dt * a
        r_i[k], v_i[k] = r, v
    return r_i, v_i


def scene(t, motion, n_sat=8, seed=3, seen=None):
    """Satellites on random circular orbits, above 10 deg elevation of the first place; seen (n,): how many are used."""
    rng, r_sat, axes = np.random.default_rng(seed), [], []
    while len(r_sat) < n_sat:
        r, axis = rng.standard_normal((2, 3))
        r = ORBIT * r / np.linalg.norm(r)
        line = r - [RADIUS, 0.0, 0.0]
        if line[0] > np.sin(np.radians(10.0)) * np.linalg.norm(line):
            r_sat.append(r)
            axes.append(np.cross(np.cross(r, axis), r))
    r0, w = np.array(r_sat), np.array(axes)
    w *= np.sqrt(GM / ORBIT**3) / np.linalg.norm(w, axis=1)[:, None]
    angle = (np.sqrt(GM / ORBIT**3) * t)[:, None, None]
    side = np.cross(w, r0) / np.sqrt(GM / ORBIT**3)
    satellite = np.cos(angle) * r0 + np.sin(angle) * side
    moving = np.sqrt(GM / ORBIT**3) * (np.cos(angle) * side - np.sin(angle) * r0)
    used = np.tile(np.arange(n_sat), (len(t), 1))
    n_used = np.full(len(t), n_sat) if seen is None else np.array(seen)
    return Scene(t, *motion(t), satellite, moving, used, n_used)


def true_ranges(at):
    """Range and range rate (n, n_sat, 2) without clock and noise."""
    line, moving = at.satellite - at.r_i[:, None], at.moving - at.v_i[:, None]
    distance = np.linalg.norm(line, axis=2)
    return np.stack([distance, np.sum(line * moving, axis=2) / distance], axis=2)


def clocks(rng, n_epoch, n_run, interval, walk=0.005):
    """Bias (m) and drift (m/s) of clocks (n_epoch, 2, n_run) as the receiver's filter takes them (eq. 4.9, 4.10)."""
    found = np.empty((n_epoch, 2, n_run))
    found[0] = [300.0 * rng.standard_normal(n_run), 3.0 * rng.standard_normal(n_run)]
    for k in range(1, n_epoch):
        push = walk * rng.standard_normal(n_run)
        found[k, 0] = found[k - 1, 0] + interval * found[k - 1, 1] + 0.5 * interval**2 * push
        found[k, 1] = found[k - 1, 1] + interval * push
    return found


def measure(at, clock, rng, sigma=(2.0, 0.1)):
    """Measurements (n_epoch, n_sat, 2, n_run)."""
    noise = rng.standard_normal((*at.satellite.shape[:2], 2, clock.shape[2])) * np.array(sigma)[:, None]
    return true_ranges(at)[..., None] + clock[:, None] + noise


@jit
def fly_point(receiver, model, satellite, moving, used, n_used, ranges, out, quality):
    """Point solutions of all epochs, eight runs: out (n, 6, 8), quality (n, 8)."""
    at, o, q = view(receiver), view(out), view(quality)
    z = view(ranges)
    for k in range(n_used.shape[0]):
        q[k] = solution(at, model, satellite[k], moving[k], used[k], n_used[k], z[k])
        for i in range(6):
            o[k, i] = at.solution[i]


@jit
def fly_filter(receiver, model, point, satellite, moving, used, n_used, ranges, out, sigma, quality):
    """Filtered solutions of all epochs, eight runs: out, sigma (n, 6, 8) (its own), quality (n, 8)."""
    at, o, c, q = view(receiver), view(out), view(sigma), view(quality)
    z = view(ranges)
    for k in range(n_used.shape[0]):
        q[k] = step(at, model, point, satellite[k], moving[k], used[k], n_used[k], z[k])
        for i in range(6):
            o[k, i] = at.solution[i]
            c[k, i] = sqrt(at.covariance[i, i])


@jit
def switch_on_lanes(receiver, place):
    """`switch_on` of eight runs at one place."""
    at = view(receiver)
    zero = number_like(at.nav[0], 0.0)
    switch_on(at, zero + place[0], zero + place[1], zero + place[2])


def _in_eights(at, ranges, fly):
    n_run = ranges.shape[3]
    assert n_run % WIDTH == 0
    for first in range(0, n_run, WIDTH):
        receiver = new_receiver(WIDTH)
        switch_on_lanes(receiver, at.r_i[0] + [3000.0, -2000.0, 5000.0])
        fly(receiver, slice(first, first + WIDTH), np.ascontiguousarray(ranges[..., first : first + WIDTH]))


def point_runs(at, model, ranges):
    """Point solutions of all runs: solution (n, 6, n_run), quality (n, n_run)."""
    n, n_run = len(at.t), ranges.shape[3]
    out, quality = np.empty((n, 6, n_run)), np.empty((n, n_run))

    def fly(receiver, lanes, z):
        o, q = np.empty((n, 6, WIDTH)), np.empty((n, WIDTH))
        fly_point(receiver, model, at.satellite, at.moving, at.used, at.n_used, z, o, q)
        out[..., lanes], quality[..., lanes] = o, q

    _in_eights(at, ranges, fly)
    return out, quality


def filter_runs(at, model, point, ranges):
    """Filtered solutions of all runs: solution, sigma (n, 6, n_run), quality (n, n_run)."""
    n, n_run = len(at.t), ranges.shape[3]
    out, sigma, quality = np.empty((n, 6, n_run)), np.empty((n, 6, n_run)), np.empty((n, n_run))

    def fly(receiver, lanes, z):
        o, c, q = np.empty((n, 6, WIDTH)), np.empty((n, 6, WIDTH)), np.empty((n, WIDTH))
        fly_filter(receiver, model, point, at.satellite, at.moving, at.used, at.n_used, z, o, c, q)
        out[..., lanes], sigma[..., lanes], quality[..., lanes] = o, c, q

    _in_eights(at, ranges, fly)
    return out, sigma, quality


def errors(at, out):
    """Truth minus solution (n, 6, n_run)."""
    return np.concatenate([at.r_i, at.v_i], axis=1)[..., None] - out
