"""Recorded pseudoranges and range rates in place of simulated measurements, for tightly coupled filters."""

from collections import Counter

import numpy as np

from lvnav_trade.gnss.satellites import satellites
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.scenario.filter_models import measured
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.simulation.preparation.signals.signals import slots
from lvnav_trade.simulation.recorded.ranges_file import Ranges, satellite_name
from lvnav_trade.simulation.recorded.residuals import Measured, compared

_FLIGHT_TIME = 0.075  # s, signal travel time of a missing range, for a clock correction that is not used
_OBSERVABLES = ("pseudorange", "range_rate")
_NAMED = 6  # largest number of satellites that a note names
_START = 4  # number of satellites of the first epoch, at which the receiver clock is removed


def with_ranges(
    prepared: Prepared, ranges: Ranges, start: float, fixes: tuple[Floats, Floats, Floats]
) -> tuple[Prepared, tuple[str, ...]]:
    """Return a prepared case with the ranges of a log as measurements, and notes on omitted ranges.

    Satellite clocks (from the ephemerides) and the delays in the filter's correction are removed, as in a receiver. So
    are bias and drift of the receiver clock at the first epoch, relative to the solution there. Satellites that the
    case does not track, below the mask, are omitted.

    Parameters
    ----------
    prepared
        Prepared case.
    ranges
        Recorded ranges.
    start
        s. Time of the first solution in the log.
    fixes
        Times (s since the start), positions and velocities (frame i) of the solutions.

    Raises
    ------
    InputError
        If the ranges contradict the solutions throughout, or if no epoch has enough satellites.
    """
    observed = _by_epoch(prepared, ranges, start)
    measurements = measured(prepared.scenario)
    sky, needed = prepared.sky, [column for column, name in enumerate(_OBSERVABLES) if name in measurements]
    tracked = np.isfinite(observed[:, :, needed]).all(axis=2) & sky.tracked
    added = _corrections(prepared, observed[:, :, 0])
    if not (tracked.sum(axis=1) >= _START).any():
        orbiting, logged = (", ".join(sorted(set(names))[:8]) for names in (sky.names, ranges.satellites))
        raise InputError(
            f"ranges: at no epoch of the case {_START} satellites that it tracks; it has {orbiting}, the log {logged}"
        )
    tracked, notes = compared(prepared, Measured(observed, added, tracked, needed), ranges.file)
    corrected = observed + added
    epoch = int(np.argmax(tracked.sum(axis=1) >= _START))
    clock = _clock(prepared, corrected, tracked, epoch, fixes)
    since = (sky.t - sky.t[epoch])[:, None]
    signals = prepared.signals
    used, n_used = slots(tracked)
    clock_errors = (clock[0] + clock[1] * since, clock[1])
    size, rate = (
        np.where(tracked & np.isfinite(corrected[:, :, k]), corrected[:, :, k] - clock_errors[k], plain)
        for k, plain in enumerate((signals.range, signals.rate))
    )
    with_log = prepared._replace(signals=signals._replace(used=used, n_used=n_used, range=size, rate=rate))
    return with_log, (*_strangers(prepared, ranges), *notes)


def _strangers(prepared: Prepared, ranges: Ranges) -> tuple[str, ...]:
    """Return a note on satellites of the log that the constellation of the case lacks; empty if there are none."""
    constellation = set(map(satellite_name, prepared.sky.names))
    counts = Counter(name for name in ranges.satellites if name not in constellation)
    if not counts:
        return ()
    named = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items())[:_NAMED])
    more = ", ..." if len(counts) > _NAMED else ""
    return (f"rows of {len(counts)} satellites that the constellation lacks are left out: {named}{more}",)


def _by_epoch(prepared: Prepared, ranges: Ranges, start: float) -> Floats:
    """Return the ranges of a log by epoch and satellite of the case, (n_epoch, n_sat, 2) m and m/s; NaN if missing."""
    number = {satellite_name(name): k for k, name in enumerate(prepared.sky.names)}
    t = prepared.sky.t  # times of validity of the measurements
    observed = np.full((t.size, len(prepared.sky.names), 2), np.nan)
    at = np.clip(np.rint((ranges.t - start - t[0]) / prepared.signals.interval).astype(int), 0, t.size - 1)
    at_epoch = np.abs(ranges.t - start - t[at]) < 0.5 * prepared.unit.dt
    for row in np.flatnonzero(at_epoch).tolist():
        if ranges.satellites[row] in number:
            observed[at[row], number[ranges.satellites[row]]] = ranges.values[row]
    return observed


def _corrections(prepared: Prepared, pseudorange: Floats) -> Floats:
    """Return the corrections added to ranges and rates (n_epoch, n_sat, 2): satellite clocks minus modelled delays."""
    scenario = prepared.scenario
    above = satellites(scenario.constellation, scenario.trajectory.epoch)
    travel_time = np.where(np.isfinite(pseudorange), pseudorange / SPEED_OF_LIGHT, _FLIGHT_TIME)
    sent = prepared.sky.t[:, None] - travel_time
    ahead, later = (above.clock(t) + above.relativity(t) for t in (sent, sent + 1.0))
    modelled = prepared.delays.modelled_troposphere + prepared.delays.modelled_ionosphere
    return np.stack([SPEED_OF_LIGHT * ahead, SPEED_OF_LIGHT * (later - ahead)], axis=2) - modelled


def _clock(
    prepared: Prepared, corrected: Floats, tracked: Bools, epoch: int, fixes: tuple[Floats, Floats, Floats]
) -> Floats:
    """Return bias (m) and drift (m/s) of the receiver clock at an epoch: medians over the satellites."""
    at = int(np.argmin(np.abs(fixes[0] - prepared.sky.t[epoch])))
    on = tracked[epoch]
    seen = sight(prepared.sky.r_i[epoch, on] - fixes[1][at], prepared.sky.v_i[epoch, on] - fixes[2][at])
    expected = np.stack([seen.distance, seen.rate], axis=1)
    return np.median(corrected[epoch, on] - expected, axis=0)
