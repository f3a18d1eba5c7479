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
    counted: bool = False,
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
    counted : bool
        The time stamps scatter: count rows and ignore the stamps.

    Returns
    -------
    ImuFit
        Fits, card, Allan deviations, coefficients.

    Raises
    ------
    InputError
        The log cannot be read, has gaps, is not equally spaced or too short, or an output never changes.
    """
    first, last = 0.0 if start is None else start, math.inf if end is None else end
    log = read_log(file, start=first, end=last, counted=counted)
    n, rate = log.t.size, 1.0 / log.dt
    factors = ladder(n, log.dt, shortest, longest)
    if n < FEWEST or len(factors) < len(NAMES) + 2:
        raise InputError(
            f"{file}: too short: {n} rows, {n * log.dt:.6g} s, {len(factors)} averaging times; at least {FEWEST} rows "
            f"and {len(NAMES) + 2} averaging times of six a decade are needed"
        )
    fits = {part: _triad(file, part, getattr(log, part), log.dt, factors) for part in _SENSORS}
    text = _card(file, log, fits)
    return ImuFit(fits, n * log.dt, rate, text, _curves(fits), _coefficients(fits))


def _triad(file: str, part: str, rates: Floats, dt: float, factors: list[int]) -> list[AxisFit]:
    for axis, column in zip("xyz", rates.T, strict=True):
        if np.ptp(column) == 0.0:
            raise InputError(f"{file}: {part} {axis} never changes: there is no noise to fit")
    return [fit(column - np.mean(column), dt, factors) for column in rates.T]


def _card(file: str, log: ImuLog, fits: dict[str, list[AxisFit]]) -> str:
    """Return the text of the card."""
    name = Path(file).stem
    tau = fits["gyro"][0].tau
    lines = [
        f"{MARK} fit-unit {Path(file).name}; comments: intervals of 95 %, of x, y and z.",
        "# A log at rest shows no bias repeatability, scale factor, misalignment or g-sensitivity: add them.",
        f"name: {_quoted(name)}",
        "source: >-",
        f"  Allan variance of the log {Path(file).name}, {log.t.size} samples at {1.0 / log.dt:.6g} Hz,"
        f" {log.t.size * log.dt:.6g} s; averaging times {tau[0]:.4g} to {tau[-1]:.4g} s",
        f'rate: "{1.0 / log.dt:.9g} Hz"',
    ]
    for part, axes in fits.items():
        body = [line for name in NAMES for line in _lines(part, name, [axis.coefficients[name] for axis in axes])]
        if any(axis.coefficients["bias_instability"].shown for axis in axes):
            body += [_floors(part, [axis.coefficients["bias_instability"] for axis in axes])]
            body.append(f"  instability_fit: {_processes(tau)}")
        worst = max(axis.spread for axis in axes)
        if worst > 1.0:
            body.insert(
                0,
                f"  # fits poorly: residuals are {worst:.3g} of their standard deviations; intervals are wider by that",
            )
        values = any(not line.lstrip().startswith("#") for line in body)
        lines += [f"{part}:" if values else f"{part}: {{}}", *body]
    return "\n".join(lines) + "\n"


def _quoted(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _processes(tau: Floats) -> str:
    """Return the setting `instability_fit`: Gauss-Markov processes that represent flicker noise.

    They cover the averaging times of the log, at least two of them per decade.
    """
    longest = float(tau[-1])
    shortest = min(1.0, 0.1 * longest)
    count = min(_MOST_PROCESSES, 1 + math.ceil(math.log10(longest / shortest) - 1e-9))
    times = f'shortest: "{shortest:.6g} s", longest: "{longest:.6g} s"'
    return f"{{processes: {count}, {times}, convention: coefficient}}"


def _floors(part: str, axes: list[Coefficient]) -> str:
    """Return the comment with the floors of the Allan deviation, the bias instability of data sheets."""
    unit, si = _UNITS[part]["bias_instability"]
    floors = "; ".join(f"{FLOOR * axis.value / units.parse(f'1 {unit}', si):.4g}" for axis in axes)
    return f"  # floor of the Allan deviation, {FLOOR:.3f} of bias_instability: {floors} {unit}"


def _lines(part: str, name: str, axes: list[Coefficient]) -> list[str]:
    """Return the lines of a coefficient: a comment with the interval or bound of each axis, and the values."""
    unit, si = _UNITS[part][name]
    factor = units.parse(f"1 {unit}", si)
    intervals = [
        f"{axis.low / factor:.4g} to {axis.high / factor:.4g}"
        if axis.shown
        else f"not shown, below {axis.high / factor:.3g}"
        for axis in axes
    ]
    comment = f"  # {name}: {'; '.join(intervals)} {unit}"
    shown = [axis.value / factor for axis in axes if axis.shown]
    if not shown:
        return [comment]
    if name == "quantisation":  # the card has one quantisation step for all axes: their RMS
        return [comment, f'  quantisation: "{np.sqrt(np.mean(np.square(shown))):.4g} {unit}"']
    values = ", ".join(f'"{axis.value / factor:.4g} {unit}"' for axis in axes)
    return [comment, f"  {name}: [{values}]"]


def _curves(fits: dict[str, list[AxisFit]]) -> pd.DataFrame:
    """Return the Allan deviations with their 95 % confidence intervals.

    The Allan variance is chi-square distributed. Its equivalent number of degrees of freedom follows from the standard
    deviation s of the deviation d: n = (d / s)^2 / 2.
    """
    from scipy.stats import chi2

    frames = []
    for part, fitted_axes in fits.items():
        for axis, fitted in zip("xyz", fitted_axes, strict=True):
            freedom = np.maximum(1.0, 0.5 * (fitted.model / fitted.sigma) ** 2)
            low, high = (fitted.deviation * np.sqrt(freedom / chi2.ppf(p, freedom)) for p in (0.975, 0.025))
            frames.append(
                pd.DataFrame(
                    {
                        "sensor": f"{_SENSORS[part]} {axis}",
                        "tau_s": fitted.tau,
                        "deviation_si": fitted.deviation,
                        "low_si": low,
                        "high_si": high,
                        "model_si": fitted.model,
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)


def _coefficients(fits: dict[str, list[AxisFit]]) -> pd.DataFrame:
    rows = []
    for part, fitted_axes in fits.items():
        for axis, fitted in zip("xyz", fitted_axes, strict=True):
            for name, coefficient in fitted.coefficients.items():
                unit, si = _UNITS[part][name]
                factor = units.parse(f"1 {unit}", si)
                numbers = [number / factor for number in coefficient[:3]]
                rows.append((f"{_SENSORS[part]} {axis}", name, unit, *numbers, coefficient.shown))
    return pd.DataFrame(rows, columns=["sensor", "coefficient", "unit", "estimate", "low", "high", "shown"])
