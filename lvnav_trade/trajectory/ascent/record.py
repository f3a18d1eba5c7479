"""Record of time, speed and altitude: its reader, the fit of a climb, and the differences of a flight from it."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import brentq
from scipy.sparse import block_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from lvnav_trade.kernels.earth import GM, SEMI_MAJOR
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.quantities.input_files import decimal_or_endless, text_lines
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.vehicle_cards import FlightRecords, Site
from lvnav_trade.trajectory.truth import Trajectory, motion

HEADER = ["time_s", "speed_m_s", "altitude_m"]
_SPACING = 5.0  # s between knots
LONGEST_HOLE = _SPACING  # s; longest gap that the fit bridges, the interval of its knots
_COAST_NOISE = 0.2  # m/s^2; allowed deviation of a coast from free fall on a non-rotating sphere
_WEIGHTS = (-3.0, 5.0)  # log10 of the weight of squared jerk between which the record's noise is sought
_STEPS = 12  # of the fit, at most; a handful are usual
_UPRIGHT = 30.0  # m/s; a slower vehicle climbs vertically
_STEEPEST = 1e-3  # m/s; below this speed its direction and derivative are undefined


class AscentRecord(NamedTuple):
    """A record: time since lift-off (n,) s, Earth-relative speed (n,) m/s, altitude over the site (n,) m."""

    t: Floats
    speed: Floats
    altitude: Floats


def read(path: str) -> AscentRecord:
    """Return the record in a CSV file with the header ``time_s,speed_m_s,altitude_m``; # begins a comment line.

    InputError with file and line: no such file, wrong header, a field that is no finite number, a time that does not
    rise, a negative speed, fewer than 12 rows.
    """
    rows: list[list[float]] = []
    for index, (number, line) in enumerate(text_lines(path, DATA_BYTES)):
        fields, where = [field.strip() for field in line.split(",")], f"{path}:{number}"
        if index > 0:
            rows.append(_row(fields, rows[-1] if rows else None, where))
        elif fields != HEADER:
            raise InputError(f"{where}: the header is {quoted(','.join(fields))}, expected {','.join(HEADER)!r}")
    if len(rows) < 12:
        raise InputError(f"{path}: {len(rows)} rows of data, an ascent needs 12 or more")
    return AscentRecord(*np.array(rows).T.copy())


def _row(fields: list[str], before: list[float] | None, where: str) -> list[float]:
    if len(fields) != len(HEADER):
        raise InputError(f"{where}: {len(fields)} fields, expected {len(HEADER)}")
    row = []
    for name, field in zip(HEADER, fields, strict=True):
        try:
            value = decimal_or_endless(field)
        except ValueError:
            raise InputError(f"{where}: {name} is {quoted(field)}, not a number") from None
        if not math.isfinite(value):
            raise InputError(f"{where}: {name} is {quoted(field)}, not a finite number")
        row.append(value)
    if row[1] < 0.0:
        raise InputError(f"{where}: speed_m_s is {fields[1]}, a speed is not negative")
    if before is not None and row[0] <= before[0]:
        fault = "repeats" if row[0] == before[0] else "goes back from"
        raise InputError(f"{where}: time_s {fields[0]} {fault} {before[0]:g} s of the row before")
    return row


def differences(recorded: FlightRecords, flight: Trajectory, site: Site) -> dict[str, float | str]:
    """Return the facts of the comparison, flight minus record.

    For speed relative to the Earth (m/s) and altitude over the site (m) they are RMS, largest difference and its time
    (s) from lift-off to injection; for every recorded event the time difference (s). InputError if the record cannot be
    read.
    """
    facts: dict[str, float | str] = {"compared_with": recorded.source}
    if recorded.file is not None:
        record = read(recorded.file)
        flown = (record.t >= 0.0) & (record.t <= flight.events["injection"])
        at = motion(flight, record.t[flown])
        speed = np.linalg.norm(earth_velocity(at.r_i, at.v_i), axis=1)
        height = geodetic_from_ecef(ecef_from_eci(at.r_i, earth_angle(flight.theta0, at.t)))[2]
        facts |= residual_facts(
            "record", AscentRecord(*(column[flown] for column in record)), speed, height - site.height
        )
    common = {name: time for name, time in recorded.events.items() if name in flight.events}
    return facts | {f"{name}_after_record_s": flight.events[name] - time for name, time in common.items()}


def residual_facts(of: str, record: AscentRecord, speed: Floats, altitude: Floats) -> dict[str, float]:
    """Return RMS and largest difference of speed (n,) m/s and altitude (n,) m from a record, and its time (s)."""
    facts: dict[str, float] = {}
    residuals = (("speed", "m_s", speed - record.speed), ("altitude", "m", altitude - record.altitude))
    for name, unit, residual in residuals:
        worst = int(np.argmax(np.abs(residual)))
        facts[f"{of}_{name}_rms_{unit}"] = float(np.sqrt(np.mean(residual**2)))
        facts[f"{of}_{name}_worst_{unit}"] = float(residual[worst])
        facts[f"{of}_{name}_worst_at_s"] = float(record.t[worst])
    return facts


def force_along(record: AscentRecord) -> Floats:
    """Return the mean specific force along the path (n - 1,) m/s^2 over each interval of a record.

    It is the acceleration plus the component of gravity along the path, which starts vertically. The Earth is assumed
    flat and not rotating.
    """
    interval, mean = np.diff(record.t), 0.5 * (record.speed[1:] + record.speed[:-1])
    rise = np.diff(record.altitude) / interval
    steepness = np.where(mean < _UPRIGHT, 1.0, rise / np.maximum(mean, _UPRIGHT))
    radius = SEMI_MAJOR + 0.5 * (record.altitude[1:] + record.altitude[:-1])
    return np.asarray(np.diff(record.speed) / interval + GM / radius**2 * steepness)


class Climb(NamedTuple):
    """Splines of altitude over the site (m) and horizontal Earth-relative speed (m/s), and the normalised RMS misfit.

    Altitude has a continuous first derivative everywhere, speed is continuous; acceleration jumps at the given breaks.
    """

    altitude: BSpline
    level: BSpline
    misfit: float

    def speed(self, t: Floats) -> Floats:
        """Return the Earth-relative speed (n,) in m/s at times t (n,)."""
        return np.asarray(np.hypot(self.altitude(t, 1), self.level(t)))


class _Problem(NamedTuple):
    """Least-squares fit of splines to a recorded ascent: altitude (suffix h) and horizontal speed (suffix u).

    The matrices multiply the free spline coefficients.

    record : Recorded times, speeds and altitudes.
    noise : Standard deviations of speed (m/s) and altitude (m).
    knots_h : Knots of the altitude spline (s).
    knots_u : Knots of the horizontal-speed spline (s).
    height : Altitude at the recorded times.
    climb : Rate of altitude at the recorded times.
    level : Horizontal speed at the recorded times.
    jerk_h : Third derivative of altitude, times the root of its weight.
    jerk_u : Second derivative of horizontal speed, times the root of its weight.
    fall : In free fall: second and first derivative of altitude, derivative of horizontal speed, horizontal speed;
        gravity (m/s^2).
    """

    record: AscentRecord
    noise: tuple[float, float]
    knots_h: Floats
    knots_u: Floats
    height: csc_array
    climb: csc_array
    level: csc_array
    jerk_h: csc_array
    jerk_u: csc_array
    fall: tuple[csc_array, csc_array, csc_array, csc_array, Floats]

    def residual(self, c: Floats) -> Floats:
        """Return the weighted residuals at free coefficients c: altitude, speed, roughness (two), free fall (two)."""
        h, u = np.split(c, [self.height.shape[1]])
        bend_h, slope_h, slope_u, level_u, gravity = self.fall
        level = level_u @ u
        down = bend_h @ h + gravity - level**2 / SEMI_MAJOR
        along = slope_u @ u + level * (slope_h @ h) / SEMI_MAJOR
        speed = (np.hypot(self.climb @ h, self.level @ u) - self.record.speed) / self.noise[0]
        altitude = (self.height @ h - self.record.altitude) / self.noise[1]
        jerk = self.jerk_h @ h, self.jerk_u @ u
        return np.concatenate([speed, altitude, *jerk, down / _COAST_NOISE, along / _COAST_NOISE])

    def jacobian(self, c: Floats) -> csc_array:
        h, u = np.split(c, [self.height.shape[1]])
        bend_h, slope_h, slope_u, level_u, _ = self.fall
        up, along = self.climb @ h, self.level @ u
        speed = self.noise[0] * np.maximum(np.hypot(up, along), _STEEPEST)
        level, rise = diags_array(level_u @ u), diags_array(slope_h @ h)
        rows = [
            [diags_array(up / speed) @ self.climb, diags_array(along / speed) @ self.level],
            [self.height / self.noise[1], None],
            [self.jerk_h, None],
            [None, self.jerk_u],
            [bend_h / _COAST_NOISE, level @ level_u * (-2.0 / SEMI_MAJOR / _COAST_NOISE)],
            [level @ slope_h / (SEMI_MAJOR * _COAST_NOISE), (slope_u + rise @ level_u / SEMI_MAJOR) / _COAST_NOISE],
        ]
        return csc_array(block_array(rows))

    def start(self) -> Floats:
        """Return initial coefficients: a fit of altitude alone, then of the horizontal speed that remains."""
        record = self.record
        h = _regularised(self.height / self.noise[1], self.jerk_h, record.altitude / self.noise[1])
        level = np.sqrt(np.maximum(record.speed**2 - (self.climb @ h) ** 2, 0.0))
        return np.concatenate([h, _regularised(self.level / self.noise[0], self.jerk_u, level / self.noise[0])])

    def solve(self, c: Floats) -> tuple[Floats, Floats]:
        """Return coefficients and residuals of the fit, from the start c.

        Levenberg-Marquardt steps, because the speed is not linear in the coefficients. In the vertical rise the speed
        does not depend on the horizontal speed, hence the damping. The cost is flat there, so that the iteration ends
        with a step that reduces it by less than 1e-5.
        """
        r, damping = self.residual(c), 1e-3
        for _ in range(_STEPS):
            rows = self.jacobian(c)
            trial = c - _damped(rows.T @ rows, rows.T @ r, damping)
            r_trial = self.residual(trial)
            gain = 1.0 - float(r_trial @ r_trial) / float(r @ r)
            if gain > 0.0:
                c, r, damping = trial, r_trial, 0.2 * damping
            else:
                damping *= 10.0
            if abs(gain) < 1e-5:
                break
        return c, r


def _damped(normal: csc_array, slope: Floats, damping: float) -> Floats:
    """Return the solution of (normal + damping times its diagonal) @ x = slope; splines make the matrix sparse."""
    return np.asarray(splu(csc_array(normal + damping * diags_array(normal.diagonal()))).solve(slope))


def _regularised(rows: csc_array, rough: csc_array, values: Floats) -> Floats:
    """Return the least-squares solution of rows @ x = values with rough @ x small."""
    return _damped(rows.T @ rows + rough.T @ rough, rows.T @ values, 1e-9)


def smooth(
    record: AscentRecord,
    breaks: list[float],
    coasts: list[tuple[float, float]],
    noise_speed: float,
    noise_altitude: float,
) -> Climb:
    """Return the smoothest climb (least integrated square of jerk) that fits the record within its noise.

    The climb starts at rest. If no smoothness gives a normalised RMS residual of 1, the nearest is used.

    Parameters
    ----------
    record : AscentRecord
    breaks : list of float
        Times (s) within the record at which acceleration jumps.
    coasts : list of (float, float)
        Intervals (s) of free fall.
    noise_speed, noise_altitude : float
        One sigma of the record (m/s, m).
    """
    problem = _problem(record, breaks, coasts, (noise_speed, noise_altitude))
    latest = problem.start()

    def fit(log_weight: float) -> Climb:
        nonlocal latest
        root = 10.0 ** (0.5 * log_weight)
        latest, residual = problem._replace(jerk_h=root * problem.jerk_h, jerk_u=root * problem.jerk_u).solve(latest)
        h, u = np.split(latest, [problem.height.shape[1]])
        misfit = float(np.sqrt(np.mean(residual[: 2 * record.t.size] ** 2)))
        altitude = BSpline(problem.knots_h, np.concatenate([[0.0, 0.0], h]), 5)
        return Climb(altitude, BSpline(problem.knots_u, np.concatenate([[0.0], u]), 4), misfit)

    low, high = _WEIGHTS
    smoothest = fit(high)
    if smoothest.misfit <= 1.0:
        return smoothest
    roughest = fit(low)
    if roughest.misfit >= 1.0:
        return roughest
    return fit(float(brentq(lambda weight: fit(weight).misfit - 1.0, low, high, xtol=0.1)))


def _knots(t: Floats, breaks: list[float], degree: int) -> Floats:
    """Return knots about `_SPACING` apart, with four at each break: continuous up to derivative degree - 4."""
    edges = [float(t[0]), *breaks, float(t[-1])]
    inner: list[float] = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        count = max(1, round((end - begin) / _SPACING))
        inner += [] if k == 0 else [begin] * 4
        inner += list(np.linspace(begin, end, count + 1)[1:-1])
    return np.array([edges[0]] * (degree + 1) + inner + [edges[-1]] * (degree + 1))


def _design(knots: Floats, degree: int, t: Floats, order: int, fixed: int) -> csc_array:
    """Return derivative `order` of every basis spline at t, without the first `fixed`, whose coefficients are zero."""
    count = len(knots) - degree - 1
    return csc_array(BSpline(knots, np.eye(count), degree)(t, order)[:, fixed:])


def _problem(
    record: AscentRecord, breaks: list[float], coasts: list[tuple[float, float]], noise: tuple[float, float]
) -> _Problem:
    """Return the least-squares problem; rest at the start means two zero coefficients of altitude and one of speed."""
    t = record.t
    knots_h, knots_u = _knots(t, breaks, 5), _knots(t, breaks, 4)
    fine = np.linspace(t[0], t[-1], 4 * len(knots_h))
    cell = np.sqrt(fine[1] - fine[0])
    free = np.concatenate([np.zeros(0), *(np.linspace(begin, end, 12)[1:-1] for begin, end in coasts)])
    gravity = GM / (SEMI_MAJOR + np.interp(free, t, record.altitude)) ** 2
    at_data = _design(knots_h, 5, t, 0, 2), _design(knots_h, 5, t, 1, 2), _design(knots_u, 4, t, 0, 1)
    jerk = cell * _design(knots_h, 5, fine, 3, 2), cell * _design(knots_u, 4, fine, 2, 1)
    bend_h, slope_h = (_design(knots_h, 5, free, order, 2) for order in (2, 1))
    slope_u, level_u = (_design(knots_u, 4, free, order, 1) for order in (1, 0))
    fall = bend_h, slope_h, slope_u, level_u, gravity
    return _Problem(record, noise, knots_h, knots_u, *at_data, *jerk, fall)
