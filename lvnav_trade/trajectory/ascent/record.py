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
        fields = [field.strip() for field in line.split(",")]
        where = f"{path}:{number}"
        if index > 0:
            rows.append(_parse_row(fields, rows[-1] if rows else None, where))
        elif fields != HEADER:
            raise InputError(f"{where}: the header is {quoted(','.join(fields))}, expected {','.join(HEADER)!r}")
    if len(rows) < 12:
        raise InputError(f"{path}: {len(rows)} rows of data, an ascent needs 12 or more")
    return AscentRecord(*np.array(rows).T.copy())


def _parse_row(fields: list[str], previous_row: list[float] | None, where: str) -> list[float]:
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
    if previous_row is not None and row[0] <= previous_row[0]:
        is_repeated = row[0] == previous_row[0]
        fault = "repeats" if is_repeated else "goes back from"
        raise InputError(f"{where}: time_s {fields[0]} {fault} {previous_row[0]:g} s of the row before")
    return row


def differences(flight_records: FlightRecords, flight: Trajectory, site: Site) -> dict[str, float | str]:
    """Return the facts of the comparison, trajectory minus record.

    For speed relative to the Earth (m/s) and altitude above the site (m) they are RMS, largest difference and its time
    (s) from lift-off to injection. For every recorded event they are the time difference (s). InputError if the record
    cannot be read.
    """
    facts: dict[str, float | str] = {"compared_with": flight_records.source}
    if flight_records.file is not None:
        record = read(flight_records.file)
        inside = (record.t >= 0.0) & (record.t <= flight.events["injection"])
        record = AscentRecord(*(column[inside] for column in record))
        true = motion(flight, record.t)
        speed = np.linalg.norm(earth_velocity(true.r_i, true.v_i), axis=1)
        r_e = ecef_from_eci(true.r_i, earth_angle(flight.theta0, true.t))
        altitude = geodetic_from_ecef(r_e)[2] - site.height
        facts |= residual_facts("record", record, speed, altitude)
    for name, time in flight_records.events.items():
        if name in flight.events:
            facts[f"{name}_after_record_s"] = flight.events[name] - time
    return facts


def residual_facts(prefix: str, record: AscentRecord, speed: Floats, altitude: Floats) -> dict[str, float]:
    """Return RMS and largest difference of speed and altitude from a record, with the time of the largest difference.

    prefix : prefix of the names of the facts
    speed, altitude : (n,) m/s, m. Values that are compared, at the times of the record.
    """
    facts: dict[str, float] = {}
    residuals = (("speed", "m_s", speed - record.speed), ("altitude", "m", altitude - record.altitude))
    for name, unit, residual in residuals:
        worst = int(np.argmax(np.abs(residual)))
        mean_square = np.mean(residual**2)
        facts[f"{prefix}_{name}_rms_{unit}"] = float(np.sqrt(mean_square))
        facts[f"{prefix}_{name}_worst_{unit}"] = float(residual[worst])
        facts[f"{prefix}_{name}_worst_at_s"] = float(record.t[worst])
    return facts


def path_force(record: AscentRecord) -> Floats:
    """Return the mean specific force along the path (n - 1,) m/s^2 over each interval of a record.

    It is the acceleration plus the component of gravity along the path, which starts vertically. The Earth is assumed
    flat and not rotating.
    """
    interval = np.diff(record.t)
    mean_speed = 0.5 * (record.speed[1:] + record.speed[:-1])
    mean_altitude = 0.5 * (record.altitude[1:] + record.altitude[:-1])
    climb_rate = np.diff(record.altitude) / interval
    flight_sine = climb_rate / np.maximum(mean_speed, _UPRIGHT)
    sine_climb = np.where(mean_speed < _UPRIGHT, 1.0, flight_sine)
    radius = SEMI_MAJOR + mean_altitude
    acceleration = np.diff(record.speed) / interval
    gravity = GM / radius**2
    return np.asarray(acceleration + gravity * sine_climb)


class _FreeFall(NamedTuple):
    """Matrices of the splines in free fall, and gravity there.

    altitude_2 : Second derivative of altitude.
    altitude_1 : First derivative of altitude.
    level_1 : Derivative of horizontal speed.
    level : Horizontal speed.
    gravity : (n,) m/s^2.
    """

    altitude_2: csc_array
    altitude_1: csc_array
    level_1: csc_array
    level: csc_array
    gravity: Floats


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


class _FitProblem(NamedTuple):
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
    fall : Matrices of the times in free fall.
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
    fall: _FreeFall

    def residual(self, c: Floats) -> Floats:
        """Return the weighted residuals at free coefficients c: altitude, speed, roughness (two), free fall (two).

        In free fall over a sphere of radius R: h'' = u^2 / R - g, and u' = -u h' / R.
        """
        h, u = np.split(c, [self.height.shape[1]])
        fall = self.fall
        level = fall.level @ u
        down = fall.altitude_2 @ h + fall.gravity - level**2 / SEMI_MAJOR
        along = fall.level_1 @ u + level * (fall.altitude_1 @ h) / SEMI_MAJOR
        speed_noise, altitude_noise = self.noise
        model_speed = np.hypot(self.climb @ h, self.level @ u)
        model_altitude = self.height @ h
        speed = (model_speed - self.record.speed) / speed_noise
        altitude = (model_altitude - self.record.altitude) / altitude_noise
        return np.concatenate(
            [
                speed,
                altitude,
                self.jerk_h @ h,
                self.jerk_u @ u,
                down / _COAST_NOISE,
                along / _COAST_NOISE,
            ]
        )

    def jacobian(self, c: Floats) -> csc_array:
        """Return the derivative of the residuals by the coefficients c."""
        h, u = np.split(c, [self.height.shape[1]])
        fall = self.fall
        up = self.climb @ h
        along = self.level @ u
        speed = self.noise[0] * np.maximum(np.hypot(up, along), _STEEPEST)
        level = diags_array(fall.level @ u)
        rise = diags_array(fall.altitude_1 @ h)
        speed_h = diags_array(up / speed) @ self.climb
        speed_u = diags_array(along / speed) @ self.level
        down_h = fall.altitude_2 / _COAST_NOISE
        down_u = level @ fall.level * (-2.0 / SEMI_MAJOR / _COAST_NOISE)
        along_h = level @ fall.altitude_1 / (SEMI_MAJOR * _COAST_NOISE)
        along_u = (fall.level_1 + rise @ fall.level / SEMI_MAJOR) / _COAST_NOISE
        blocks = [
            [speed_h, speed_u],
            [self.height / self.noise[1], None],
            [self.jerk_h, None],
            [None, self.jerk_u],
            [down_h, down_u],
            [along_h, along_u],
        ]
        return csc_array(block_array(blocks))

    def start(self) -> Floats:
        """Return initial coefficients: a fit of altitude alone, then of the horizontal speed that remains."""
        speed_noise, altitude_noise = self.noise
        record = self.record
        h = _solve_regularised(self.height / altitude_noise, self.jerk_h, record.altitude / altitude_noise)
        level = np.sqrt(np.maximum(record.speed**2 - (self.climb @ h) ** 2, 0.0))
        u = _solve_regularised(self.level / speed_noise, self.jerk_u, level / speed_noise)
        return np.concatenate([h, u])

    def solve(self, c: Floats) -> tuple[Floats, Floats]:
        """Return coefficients and residuals of the fit, from the start c.

        Levenberg-Marquardt steps, because the speed is not linear in the coefficients. In the vertical rise the speed
        does not depend on the horizontal speed, hence the damping. The cost is flat there, so that the iteration ends
        with a step that reduces it by less than 1e-5.
        """
        residual = self.residual(c)
        damping = 1e-3
        for _ in range(_STEPS):
            jacobian = self.jacobian(c)
            trial = c - _solve_damped(jacobian.T @ jacobian, jacobian.T @ residual, damping)
            trial_residual = self.residual(trial)
            gain = 1.0 - float(trial_residual @ trial_residual) / float(residual @ residual)
            if gain > 0.0:
                c, residual = trial, trial_residual
                damping = 0.2 * damping
            else:
                damping *= 10.0
            if abs(gain) < 1e-5:
                break
        return c, residual


def _solve_damped(normal: csc_array, slope: Floats, damping: float) -> Floats:
    """Return the solution of (normal + damping times its diagonal) @ x = slope; splines make the matrix sparse."""
    diagonal = diags_array(normal.diagonal())
    matrix = csc_array(normal + damping * diagonal)
    return np.asarray(splu(matrix).solve(slope))


def _solve_regularised(rows: csc_array, rough: csc_array, values: Floats) -> Floats:
    """Return the least-squares solution x of rows @ x = values, regularised by the squared norm of rough @ x."""
    normal = rows.T @ rows + rough.T @ rough
    slope = rows.T @ values
    return _solve_damped(normal, slope, 1e-9)


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
    problem = _fit_problem(record, breaks, coasts, (noise_speed, noise_altitude))
    latest = problem.start()
    n_data = 2 * record.t.size

    def fit(log_weight: float) -> Climb:
        nonlocal latest
        root = 10.0 ** (0.5 * log_weight)
        weighted_problem = problem._replace(jerk_h=root * problem.jerk_h, jerk_u=root * problem.jerk_u)
        latest, residual = weighted_problem.solve(latest)
        h, u = np.split(latest, [problem.height.shape[1]])
        return Climb(
            altitude=BSpline(problem.knots_h, np.concatenate([[0.0, 0.0], h]), 5),
            level=BSpline(problem.knots_u, np.concatenate([[0.0], u]), 4),
            misfit=float(np.sqrt(np.mean(residual[:n_data] ** 2))),
        )

    low, high = _WEIGHTS
    smoothest = fit(high)
    if smoothest.misfit <= 1.0:
        return smoothest
    roughest = fit(low)
    if roughest.misfit >= 1.0:
        return roughest
    log_weight = brentq(lambda weight: fit(weight).misfit - 1.0, low, high, xtol=0.1)
    return fit(float(log_weight))


def _knots(t: Floats, breaks: list[float], degree: int) -> Floats:
    """Return knots about `_SPACING` apart, with four at each break: continuous up to derivative degree - 4."""
    edges = [float(t[0]), *breaks, float(t[-1])]
    inner: list[float] = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        count = max(1, round((end - begin) / _SPACING))
        inner += [] if k == 0 else [begin] * 4
        inner += list(np.linspace(begin, end, count + 1)[1:-1])
    first_knots = [edges[0]] * (degree + 1)
    last_knots = [edges[-1]] * (degree + 1)
    return np.array(first_knots + inner + last_knots)


def _design(knots: Floats, degree: int, t: Floats, order: int, omitted_count: int) -> csc_array:
    """Return the sparse design matrix (n, n_basis - omitted_count) of derivative `order` of the basis splines.

    t : (n,) s. Times.
    omitted_count : number of first basis splines to omit, whose coefficients are zero
    """
    count = len(knots) - degree - 1
    basis = BSpline(knots, np.eye(count), degree)
    values = basis(t, order)
    return csc_array(values[:, omitted_count:])


def _fit_problem(
    record: AscentRecord, breaks: list[float], coasts: list[tuple[float, float]], noise: tuple[float, float]
) -> _FitProblem:
    """Return the least-squares problem; rest at the start means two zero coefficients of altitude and one of speed."""
    t = record.t
    knots_h = _knots(t, breaks, 5)
    knots_u = _knots(t, breaks, 4)
    # The integral of the squared jerk is a sum over a fine grid.
    fine = np.linspace(t[0], t[-1], 4 * len(knots_h))
    root_cell = np.sqrt(fine[1] - fine[0])
    coast_times = [np.linspace(begin, end, 12)[1:-1] for begin, end in coasts]
    fall_t = np.concatenate([np.zeros(0), *coast_times])
    fall = _FreeFall(
        altitude_2=_design(knots_h, 5, fall_t, 2, 2),
        altitude_1=_design(knots_h, 5, fall_t, 1, 2),
        level_1=_design(knots_u, 4, fall_t, 1, 1),
        level=_design(knots_u, 4, fall_t, 0, 1),
        gravity=GM / (SEMI_MAJOR + np.interp(fall_t, t, record.altitude)) ** 2,
    )
    return _FitProblem(
        record=record,
        noise=noise,
        knots_h=knots_h,
        knots_u=knots_u,
        height=_design(knots_h, 5, t, 0, 2),
        climb=_design(knots_h, 5, t, 1, 2),
        level=_design(knots_u, 4, t, 0, 1),
        jerk_h=root_cell * _design(knots_h, 5, fine, 3, 2),
        jerk_u=root_cell * _design(knots_u, 4, fine, 2, 1),
        fall=fall,
    )
