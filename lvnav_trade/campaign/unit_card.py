"""Card of an IMU from its log at rest: noise coefficients by Allan variance, with their intervals as comments."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.syntax.card_lookup import MARK
from lvnav_trade.imu.allan import FLOOR
from lvnav_trade.imu.allan_fit import FEWEST, NAMES, AxisFit, Coefficient, fit, ladder
from lvnav_trade.quantities import units
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.recorded.imu_log import ImuLog, read_log

_SENSORS = {"gyro": "gyro", "accel": "accelerometer"}
_UNITS = {
    "gyro": {
        "random_walk": ("deg/sqrt(h)", "rad/s**0.5"),
        "rate_random_walk": ("deg/h/sqrt(h)", "rad/s**1.5"),
        "bias_instability": ("deg/h", "rad/s"),
        "quantisation": ("arcsec", "rad"),
    },
    "accel": {
        "random_walk": ("m/s/sqrt(h)", "m/s**1.5"),
        "rate_random_walk": ("mg/sqrt(h)", "m/s**2.5"),
        "bias_instability": ("mg", "m/s**2"),
        "quantisation": ("mm/s", "m/s"),
    },
}
_MOST_PROCESSES = 6


class ImuFit(NamedTuple):
    """Error model of an IMU, fitted to its log at rest."""

    fits: dict[str, list[AxisFit]]  # by sensor (gyro, accel), of the axes x, y and z
    seconds: float  # duration of the log, s
    rate: float  # sampling rate of the log, Hz
    text: str  # YAML of the card
    curves: pd.DataFrame  # Allan deviations by sensor and axis: tau_s, deviation_si, low_si, high_si, model_si
    coefficients: pd.DataFrame  # one row per sensor axis and coefficient, in the unit of the row


def fit_unit(
    file: str,
    start: float | None = None,
    end: float | None = None,
    shortest: float = 0.0,
    longest: float = math.inf,
    ignore_time_stamps: bool = False,
) -> ImuFit:
    """Fit the error model of an IMU to its log at rest, by Allan variance.

    Parameters
    ----------
    file : str
        Log, CSV or Parquet.
    start, end : float, optional
        Begin and end of the evaluated part, s after the first row.
    shortest, longest : float
        Smallest and largest averaging time of the fit (s).
    ignore_time_stamps : bool
        Whether rows are numbered and their time stamps ignored, because the stamps scatter.

    Returns
    -------
    ImuFit
        Fits, card, Allan deviations, coefficients.

    Raises
    ------
    InputError
        The log cannot be read, has gaps, is not equally spaced or too short, or an output never changes.
    """
    first = 0.0 if start is None else start
    last = math.inf if end is None else end
    log = read_log(file, start=first, end=last, counts_rows=ignore_time_stamps)
    n = log.t.size
    factors = ladder(n, log.dt, shortest, longest)
    fewest_times = len(NAMES) + 2
    if n < FEWEST or len(factors) < fewest_times:
        raise InputError(
            f"{file}: too short: {n} rows, {n * log.dt:.6g} s, {len(factors)} averaging times; at least {FEWEST} rows "
            f"and {fewest_times} averaging times of six a decade are needed"
        )
    fits = {sensor: _fit_axes(file, sensor, getattr(log, sensor), log.dt, factors) for sensor in _SENSORS}
    return ImuFit(
        fits=fits,
        seconds=n * log.dt,
        rate=1.0 / log.dt,
        text=_card(file, log, fits),
        curves=_curves(fits),
        coefficients=_coefficients(fits),
    )


def _fit_axes(file: str, sensor: str, rates: Floats, dt: float, factors: list[int]) -> list[AxisFit]:
    """Return the fits of the axes x, y and z of a sensor.

    Parameters
    ----------
    file : str
        Name of the log, for messages.
    sensor : str
        gyro or accel.
    rates : (n, 3) array
        Angular rate (rad/s) or specific force (m/s^2).
    dt : float
        Sampling interval (s).
    factors : list of int
        Averaging times, in samples.

    Raises
    ------
    InputError
        An output never changes.
    """
    for axis, column in zip("xyz", rates.T, strict=True):
        if np.ptp(column) == 0.0:
            raise InputError(f"{file}: {sensor} {axis} never changes: there is no noise to fit")
    return [fit(column - np.mean(column), dt, factors) for column in rates.T]


def _card(file: str, log: ImuLog, fits: dict[str, list[AxisFit]]) -> str:
    """Return the text of the card of the IMU.

    Parameters
    ----------
    file : str
        Name of the log.
    log : ImuLog
        The log, with its duration and sampling interval.
    fits : dict of str to list of AxisFit
        Fits of the axes x, y and z, by sensor (gyro, accel).
    """
    name = Path(file).stem
    tau = fits["gyro"][0].tau
    lines = [
        f"{MARK} fit-unit {Path(file).name}; comments: intervals of 95 %, of x, y and z.",
        "# A log at rest shows no bias repeatability, scale factor, misalignment or g-sensitivity: add them.",
        f"name: {_yaml_string(name)}",
        "source: >-",
        f"  Allan variance of the log {Path(file).name}, {log.t.size} samples at {1.0 / log.dt:.6g} Hz,"
        f" {log.t.size * log.dt:.6g} s; averaging times {tau[0]:.4g} to {tau[-1]:.4g} s",
        f'rate: "{1.0 / log.dt:.9g} Hz"',
    ]
    for sensor, axes in fits.items():
        lines += _sensor_lines(sensor, axes, tau)
    return "\n".join(lines) + "\n"


def _sensor_lines(sensor: str, axes: list[AxisFit], tau: Floats) -> list[str]:
    """Return the lines of a sensor in the card: quality of the fit, coefficients, bias instability.

    Parameters
    ----------
    sensor : str
        gyro or accel.
    axes : list of AxisFit
        Fits of the axes x, y and z.
    tau : (n,) array
        Averaging times (s), ascending.
    """
    body = []
    largest_residual = max(axis.spread for axis in axes)  # RMS residual in standard deviations
    if largest_residual > 1.0:
        body.append(
            f"  # fits poorly: residuals are {largest_residual:.3g} of their standard deviations; intervals are wider "
            "by that"
        )
    for name in NAMES:
        body += _coefficient_lines(sensor, name, [axis.coefficients[name] for axis in axes])
    instabilities = [axis.coefficients["bias_instability"] for axis in axes]
    if any(instability.is_significant for instability in instabilities):
        body.append(_floors(sensor, instabilities))
        body.append(f"  instability_fit: {_processes(tau)}")
    has_values = any(not line.lstrip().startswith("#") for line in body)
    heading = f"{sensor}:" if has_values else f"{sensor}: {{}}"
    return [heading, *body]


def _yaml_string(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _processes(tau: Floats) -> str:
    """Return the setting `instability_fit`: Gauss-Markov processes that represent flicker noise.

    They cover the averaging times of the log, at least two of them per decade.
    """
    longest = float(tau[-1])
    shortest = min(1.0, 0.1 * longest)
    decades = math.log10(longest / shortest)
    count = min(_MOST_PROCESSES, 1 + math.ceil(decades - 1e-9))
    times = f'shortest: "{shortest:.6g} s", longest: "{longest:.6g} s"'
    return f"{{processes: {count}, {times}, convention: coefficient}}"


def _floors(sensor: str, axes: list[Coefficient]) -> str:
    """Return the comment with the floors of the Allan deviation, the bias instability of data sheets."""
    unit, si = _UNITS[sensor]["bias_instability"]
    factor = units.parse(f"1 {unit}", si)
    floors = "; ".join(f"{FLOOR * axis.value / factor:.4g}" for axis in axes)
    return f"  # floor of the Allan deviation, {FLOOR:.3f} of bias_instability: {floors} {unit}"


def _coefficient_lines(sensor: str, name: str, axes: list[Coefficient]) -> list[str]:
    """Return the lines of a coefficient: a comment with the interval or bound of each axis, and the values.

    Parameters
    ----------
    sensor : str
        gyro or accel.
    name : str
        Name of the coefficient.
    axes : list of Coefficient
        Coefficient of the axes x, y and z, SI.
    """
    unit, si = _UNITS[sensor][name]
    factor = units.parse(f"1 {unit}", si)
    intervals = []
    for axis in axes:
        if axis.is_significant:
            intervals.append(f"{axis.low / factor:.4g} to {axis.high / factor:.4g}")
        else:
            intervals.append(f"not shown, below {axis.high / factor:.3g}")
    comment = f"  # {name}: {'; '.join(intervals)} {unit}"
    significant_values = [axis.value / factor for axis in axes if axis.is_significant]
    if not significant_values:
        return [comment]
    if name == "quantisation":  # the card has one quantisation step for all axes: their RMS
        rms = np.sqrt(np.mean(np.square(significant_values)))
        return [comment, f'  quantisation: "{rms:.4g} {unit}"']
    values = ", ".join(f'"{axis.value / factor:.4g} {unit}"' for axis in axes)
    return [comment, f"  {name}: [{values}]"]


def _curves(fits: dict[str, list[AxisFit]]) -> pd.DataFrame:
    """Return the Allan deviations with their 95 % confidence intervals.

    The Allan variance is chi-square distributed. Its equivalent number of degrees of freedom follows from the standard
    deviation s of the deviation d: n = (d / s)^2 / 2.
    """
    from scipy.stats import chi2

    curves = []
    for sensor, axis_fits in fits.items():
        for axis, axis_fit in zip("xyz", axis_fits, strict=True):
            degrees_of_freedom = np.maximum(1.0, 0.5 * (axis_fit.model / axis_fit.sigma) ** 2)
            low_factor = np.sqrt(degrees_of_freedom / chi2.ppf(0.975, degrees_of_freedom))
            high_factor = np.sqrt(degrees_of_freedom / chi2.ppf(0.025, degrees_of_freedom))
            columns = {
                "sensor": f"{_SENSORS[sensor]} {axis}",
                "tau_s": axis_fit.tau,
                "deviation_si": axis_fit.deviation,
                "low_si": axis_fit.deviation * low_factor,
                "high_si": axis_fit.deviation * high_factor,
                "model_si": axis_fit.model,
            }
            curves.append(pd.DataFrame(columns))
    return pd.concat(curves, ignore_index=True)


def _coefficients(fits: dict[str, list[AxisFit]]) -> pd.DataFrame:
    """Return the coefficients with their intervals, one row per sensor axis and coefficient."""
    rows = []
    for sensor, axis_fits in fits.items():
        for axis, axis_fit in zip("xyz", axis_fits, strict=True):
            for name, coefficient in axis_fit.coefficients.items():
                unit, si = _UNITS[sensor][name]
                factor = units.parse(f"1 {unit}", si)
                row = {
                    "sensor": f"{_SENSORS[sensor]} {axis}",
                    "coefficient": name,
                    "unit": unit,
                    "estimate": coefficient.value / factor,
                    "low": coefficient.low / factor,
                    "high": coefficient.high / factor,
                    "shown": coefficient.is_significant,
                }
                rows.append(row)
    return pd.DataFrame(rows, columns=["sensor", "coefficient", "unit", "estimate", "low", "high", "shown"])
