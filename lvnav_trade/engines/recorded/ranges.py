"""Recorded pseudoranges and range rates in place of simulated ones, for filters that take ranges."""

from collections import Counter

import numpy as np

from lvnav_trade.engines.recorded.residuals import Measured, compared
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.setup.receiver.signals import slots
from lvnav_trade.errors import InputError
from lvnav_trade.filter_models import measured
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.line_of_sight import sight
from lvnav_trade.records import Bools, Floats
from lvnav_trade.world.sky.satellites import satellites
from lvnav_trade.world.user_file.ranges_file import Ranges, satellite_name

_FLIGHT_TIME = 0.075  # s of a signal, where none was received: for a clock that is not used
_OBSERVABLES = ("pseudorange", "range_rate")
_NAMED = 6  # satellites that a note names
_START = 4  # satellites at which the receiver's clock is taken off


def with_ranges(
    prepared: Prepared, ranges: Ranges, start: float, fixes: tuple[Floats, Floats, Floats]
) -> tuple[Prepared, tuple[str, ...]]:
    """Return a prepared case whose receiver measures what a log has, and notes on ranges that are left out; start: s of
    its first solution in the log.

    The clocks of the satellites (their ephemerides) and the delays that the filter models are taken off, as a receiver
    does; so are bias and drift that its own clock has at the first epoch, against the solution there. What is not
    tracked by the case, below the mask, is left out.

    fixes: times (s since the start), positions and velocities (frame i) of solutions.

    InputError where the ranges contradict the solutions as a whole.
    """
    observed = _by_epoch(prepared, ranges, start)
    sky, needed = prepared.sky, [_OBSERVABLES.index(one) for one in _OBSERVABLES if one in measured(prepared.scenario)]
    tracked = np.isfinite(observed[:, :, needed]).all(axis=2) & sky.tracked
    added = _corrections(prepared, observed[:, :, 0])
    if not (tracked.sum(axis=1) >= _START).any():
        known, logged = (", ".join(sorted(set(names))[:8]) for names in (sky.names, ranges.satellites))
        raise InputError(
            f"ranges: at no epoch of the case {_START} satellites that it tracks; it has {known}, the log {logged}"
        )
    tracked, notes = compared(prepared, Measured(observed, added, tracked, needed), ranges.file)
    corrected = observed + added
    epoch = int(np.argmax(tracked.sum(axis=1) >= _START))
    clock = _clock(prepared, corrected, tracked, epoch, fixes)
    since = (sky.t - sky.t[epoch])[:, None]
    signals = prepared.signals
    used, n_used = slots(tracked)
    off = (clock[0] + clock[1] * since, clock[1])
    size, rate = (
        np.where(tracked & np.isfinite(corrected[:, :, k]), corrected[:, :, k] - off[k], plain)
        for k, plain in enumerate((signals.range, signals.rate))
    )
    found = prepared._replace(signals=signals._replace(used=used, n_used=n_used, range=size, rate=rate))
    return found, (*_strangers(prepared, ranges), *notes)


def _strangers(prepared: Prepared, ranges: Ranges) -> tuple[str, ...]:
    """Return a note on the satellites of a log that the case's constellation lacks, where there are any."""
    known = set(map(satellite_name, prepared.sky.names))
    counts = Counter(name for name in ranges.satellites if name not in known)
    if not counts:
        return ()
    named = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items())[:_NAMED])
    more = ", ..." if len(counts) > _NAMED else ""
    return (f"rows of {len(counts)} satellites that the constellation lacks are left out: {named}{more}",)


def _by_epoch(prepared: Prepared, ranges: Ranges, start: float) -> Floats:
    """Return the rows of a log by epoch and satellite of the case, (n_epoch, n_sat, 2) m and m/s, NaN where none."""
    number = {satellite_name(name): k for k, name in enumerate(prepared.sky.names)}
    t = prepared.sky.t  # when what arrives at an epoch was valid
    found = np.full((t.size, len(prepared.sky.names), 2), np.nan)
    at = np.clip(np.rint((ranges.t - start - t[0]) / prepared.signals.interval).astype(int), 0, t.size - 1)
    met = np.abs(ranges.t - start - t[at]) < 0.5 * prepared.unit.dt
    for row in np.flatnonzero(met).tolist():
        if ranges.satellites[row] in number:
            found[at[row], number[ranges.satellites[row]]] = ranges.values[row]
    return found


def _corrections(prepared: Prepared, pseudorange: Floats) -> Floats:
    """Return what is added to ranges and rates (n_epoch, n_sat, 2): satellite clocks, less delays that are modelled."""
    scenario = prepared.scenario
    above = satellites(scenario.constellation, scenario.trajectory.epoch)
    flown = np.where(np.isfinite(pseudorange), pseudorange / SPEED_OF_LIGHT, _FLIGHT_TIME)
    sent = prepared.sky.t[:, None] - flown
    ahead, later = (above.clock(t) + above.relativity(t) for t in (sent, sent + 1.0))
    modelled = prepared.delays.modelled_troposphere + prepared.delays.modelled_ionosphere
    return np.stack([SPEED_OF_LIGHT * ahead, SPEED_OF_LIGHT * (later - ahead)], axis=2) - modelled


def _clock(
    prepared: Prepared, corrected: Floats, tracked: Bools, epoch: int, fixes: tuple[Floats, Floats, Floats]
) -> Floats:
    """Return bias (m) and drift (m/s) of the receiver's clock at an epoch: medians over its satellites."""
    at = int(np.argmin(np.abs(fixes[0] - prepared.sky.t[epoch])))
    on = tracked[epoch]
    seen = sight(prepared.sky.r_i[epoch, on] - fixes[1][at], prepared.sky.v_i[epoch, on] - fixes[2][at])
    expected = np.stack([seen.distance, seen.rate], axis=1)
    return np.median(corrected[epoch, on] - expected, axis=0)
