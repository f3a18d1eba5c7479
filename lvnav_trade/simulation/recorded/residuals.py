"""Consistency of recorded ranges with the recorded solutions, independent of the receiver clock."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.simulation.preparation.prepare import Prepared

_FEWEST_RESIDUALS = 4  # smallest number of satellites of an epoch for the median that removes the receiver clock
_CONTRADICTED = (300.0, 10.0)  # m and m/s, limits of the median: above almanac and delay errors, below a wrong time
_WILD, _SCATTERS_OF_RESIDUALS = (500.0, 10.0), 15.0  # limit of a single residual: m and m/s, and multiple of the median
_MOST_WILD_RESIDUALS = 0.1  # largest fraction of measurements that may be omitted
_FITS = 0.1  # fraction of the median residual that a fitting interpretation of the column may leave
_NAMED = 6
_WAVELENGTH = SPEED_OF_LIGHT / 1575.42e6
_READINGS = (
    (-1.0, "its sign is reversed: is it a Doppler shift in m/s?"),
    (-_WAVELENGTH, "it fits as a Doppler shift in Hz of 1575.42 MHz: multiply it by -0.190294 m"),
    (_WAVELENGTH, "it fits as a range rate in cycles of 1575.42 MHz: multiply it by 0.190294 m"),
    (1000.0, "it fits in km/s"),
    (0.001, "it fits in mm/s"),
)


class Measured(NamedTuple):
    """Recorded ranges and range rates.

    observed : (n_epoch, n_sat, 2) m, m/s. As measured.
    added : (n_epoch, n_sat, 2) m, m/s. Corrections to be added.
    tracked : (n_epoch, n_sat). Whether they are used.
    needed : Columns that the filter processes.
    """

    observed: Floats
    added: Floats
    tracked: Bools
    needed: list[int]


def compared(prepared: Prepared, log: Measured, file: str) -> tuple[Bools, tuple[str, ...]]:
    """Return whether measurements are used (n_epoch, n_sat), and notes on those that contradict the solutions.

    Raises
    ------
    InputError
        If the measurements contradict the solutions throughout.
    """
    expected = _expected(prepared)
    near = _near_solution(prepared)[:, None] & log.tracked
    omitted, worst = np.zeros_like(log.tracked), {}
    for at in log.needed:
        residuals = _left(log.observed[:, :, at] + log.added[:, :, at] - expected[:, :, at], near)
        seen = np.abs(residuals[np.isfinite(residuals)])
        if not seen.size:
            continue
        typical = float(np.median(seen))
        if typical > _CONTRADICTED[at]:
            hint = (
                _range_hint(residuals, expected[:, :, 1])
                if at == 0
                else _rate_hint(log, expected[:, :, 1], near, typical)
            )
            raise InputError(
                f"{file}: {('pseudorange_m', 'range_rate_m_s')[at]} contradicts the solutions: without the receiver's "
                f"clock, half of them are off by more than {_sized(typical, at)}; {hint}"
            )
        wild = np.abs(np.nan_to_num(residuals)) > max(_WILD[at], _SCATTERS_OF_RESIDUALS * typical)
        omitted |= wild
        if wild.any():
            worst[at] = float(np.nanmax(np.abs(residuals)))
    count = int(np.count_nonzero(omitted))
    if not count:
        return log.tracked, ()
    sizes = " and ".join(_sized(size, at) for at, size in worst.items())
    names = Counter(prepared.sky.names[k] for k in np.nonzero(omitted)[1].tolist())
    named = ", ".join(f"{name} ({times})" for name, times in sorted(names.items())[:_NAMED])
    note = f"{count} of {np.count_nonzero(near)} ranges contradict the solutions, by up to {sizes}"
    if count > max(1.0, _MOST_WILD_RESIDUALS * np.count_nonzero(near)):
        raise InputError(f"{file}: {note}: {named}")
    return log.tracked & ~omitted, (f"{note}: left out, by satellite: {named}",)


def _sized(size: float, at: int) -> str:
    return f"{size * 1e-3:.4g} km{('', '/s')[at]}" if size >= 1e3 else f"{size:.3g} m{('', '/s')[at]}"


def _expected(prepared: Prepared) -> Floats:
    """Return the ranges and range rates (n_epoch, n_sat, 2) m and m/s by the solutions, without clocks."""
    sky, signals = prepared.sky, prepared.signals
    seen = sight(sky.r_i - signals.position[:, None, :], sky.v_i - signals.velocity[:, None, :])
    return np.stack([seen.distance, seen.rate], axis=2)


def _near_solution(prepared: Prepared) -> Bools:
    """Return whether the epochs (n_epoch,) have a solution of the log."""
    return np.asarray(prepared.signals.n_used > 0)


def _left(difference: Floats, used: Bools) -> Floats:
    """Return differences (n_epoch, n_sat) minus the median of their epoch; NaN if unused or with too few satellites."""
    residuals = np.where(used & np.isfinite(difference), difference, np.nan)
    few = np.isfinite(residuals).sum(axis=1) < _FEWEST_RESIDUALS
    residuals[few] = np.nan
    some = ~few
    residuals[some] -= np.nanmedian(residuals[some], axis=1, keepdims=True)
    return residuals


def _range_hint(left: Floats, rate: Floats) -> str:
    """Return a hint on the cause of range residuals: a time offset of the satellites if it explains them."""
    motion = _left(rate, np.isfinite(left))
    on = np.isfinite(left) & np.isfinite(motion)
    shift = float(np.sum(left[on] * motion[on]) / max(np.sum(motion[on] ** 2), 1e-9))
    rest = np.median(np.abs(left[on] - shift * motion[on]))
    if rest <= _FITS * np.median(np.abs(left[on])):
        return (
            f"the satellites fit {abs(shift):.1f} s {'later' if shift > 0.0 else 'earlier'}: is the epoch UTC, and do "
            "the columns of time count from it (leap seconds: time_scale)?"
        )
    return "are the epoch, the constellation (of that day) and the unit right?"


def _rate_hint(log: Measured, rate: Floats, near: Bools, typical: float) -> str:
    """Return a hint on the interpretation of the range-rate column that fits, if there is one."""
    for factor, hint in _READINGS:
        residuals = _left(factor * log.observed[:, :, 1] + log.added[:, :, 1] - rate, near)
        if np.nanmedian(np.abs(residuals)) <= min(_CONTRADICTED[1], _FITS * typical):
            return hint
    return "are the epoch and the unit right?"
