"""A recorded log in place of a simulated flight, with its ranges in place of simulated ones."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from lvnav_trade.gnss.satellites import satellites
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, gmst, quaternions, rotation_e_n
from lvnav_trade.quantities.frames import matrices as matrices_of
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats, Ints, Reference
from lvnav_trade.quantities.times import utc_after
from lvnav_trade.scenario.filter_models import epoch_interval, measured, solves
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare
from lvnav_trade.simulation.preparation.signals.receiver_measurements import slots
from lvnav_trade.simulation.recorded.alignment import Alignment, increments_to
from lvnav_trade.simulation.recorded.log_consistency import RecordedRanges, compared, inertial_fixes
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog, Ranges, satellite_name
from lvnav_trade.trajectory.truth import Phase, Trajectory, attitude_spline

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
    sky = prepared.sky
    needed = [column for column, name in enumerate(_OBSERVABLES) if name in measurements]
    tracked = np.isfinite(observed[:, :, needed]).all(axis=2) & sky.tracked
    added = _corrections(prepared, observed[:, :, 0])
    if not (tracked.sum(axis=1) >= _START).any():
        orbiting, logged = (", ".join(sorted(set(names))[:8]) for names in (sky.names, ranges.satellites))
        raise InputError(
            f"ranges: at no epoch of the case {_START} satellites that it tracks; it has {orbiting}, the log {logged}"
        )
    tracked, notes = compared(prepared, RecordedRanges(observed, added, tracked, needed), ranges.file)
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


_SOLUTION = {"position", "velocity"}
_RANGES = {"pseudorange", "range_rate"}
_FEWEST = 10  # smallest number of solutions for a replay
_KNOTS = 0.1  # s between knots of the reference attitude
_SATELLITES = 4  # number of satellites that marks an epoch with a solution


def refuse_unable(scenario: Scenario, card: NavigationLog) -> None:
    """Raise InputError if the filter of a case needs measurements that a log lacks."""
    has = _SOLUTION | (_RANGES if card.ranges is not None else set())
    others = [name for name in measured(scenario) if name not in has]
    if others or not measured(scenario):
        what = ", ".join(others) or "no measurement"
        raise InputError(f"the filter takes {what}; the log has {', '.join(sorted(has))}")
    if not isinstance(scenario.imu, ImuCard):
        raise InputError("imu: the log is of one IMU, but the campaign has several")
    if solves(scenario):
        raise InputError("receiver.solution: solved from simulated ranges; a log has the solution (kind: direct)")
    if scenario.receiver.antennas and len(scenario.receiver.antennas) > 1:
        raise InputError("receiver: the log is of one antenna, but the campaign has several")


class LogReplay(NamedTuple):
    """Case prepared for a replay of a log, and notes on omitted parts of the log."""

    prepared: Prepared
    notes: tuple[str, ...] = ()


def replayed(scenario: Scenario, log: NavigationData, card: NavigationLog, aligned: Alignment) -> LogReplay:
    """Return a case prepared for a replay of a log, from the end of its rest on.

    The truth side is the log: its increments without further errors, the receiver's solutions, and the path through
    them as reference. Nothing is drawn. Time counts from the first solution after the rest.

    Parameters
    ----------
    scenario
        Validated model of the case.
    log, card
        Recorded log, and its card.
    aligned
        Alignment at the end of the rest.

    Raises
    ------
    InputError
        If the log has fewer IMU rows per second than the case, or if its solutions are not at epochs of the case.
    """
    refuse_unable(scenario, card)
    rate = scenario.imu.rate
    first = int(np.argmax(log.t_fix >= aligned.t))
    start = float(log.t_fix[first])
    end = float(min(log.t_fix[-1], log.t[-1]))
    log_rate = (log.t.size - 1) / float(log.t[-1] - log.t[0])
    if rate > 1.5 * log_rate:
        raise InputError(f"imu.rate: {rate:g} Hz; the log has {log_rate:.4g} rows a second")
    epoch = utc_after(log.epoch, start)
    flown = scenario.trajectory.model_copy(update={"epoch": epoch})
    scenario = scenario.model_copy(update={"trajectory": flown, "faults": ()})
    lever = np.array(scenario.receiver.lever_b)
    fixes = inertial_fixes(log, start, gmst(epoch))
    trajectory, reference = _reference(scenario, log, aligned, fixes, lever, (start, end), epoch)
    prepared = prepare(scenario, epoch_interval(scenario), flown=(trajectory, reference))
    prepared = _on_log(prepared, fixes, log, card)
    if log.ranges is None or not scenario.filter.tight:
        return LogReplay(prepared)
    return LogReplay(*with_ranges(prepared, log.ranges, start, fixes))


def _reference(
    scenario: Scenario,
    log: NavigationData,
    aligned: Alignment,
    fixes: tuple[Floats, Floats, Floats],
    lever: Floats,
    span: tuple[float, float],
    epoch: str,
) -> tuple[Trajectory, Reference]:
    """Return the path of the IMU through the solutions, and its increments on the ticks of the case."""
    rate, (start, end) = scenario.imu.rate, span
    n = int(np.floor((end - start) * rate + 1e-6))
    t = np.arange(n + 1) / rate
    turned, pushed = (increments_to(log, start + t, part) for part in (log.turned, log.pushed))
    dtheta = np.diff(turned, axis=0) - aligned.gyro_bias / rate
    dvel = np.diff(pushed, axis=0)
    theta0 = gmst(epoch)
    at = int(np.argmax(log.t_fix >= start))
    C_i_n = rotation_e_n(log.place[at, 0], log.place[at, 1]) @ _turned(theta0)
    # the body is assumed at rest between the end of the rest and the first solution, a fraction of a second
    C = _accumulated(C_i_n.T @ aligned.C_b_n, dtheta)
    q = quaternions(C)
    w_b = np.vstack([dtheta[:1], dtheta]) * rate
    inside = (fixes[0] >= 0.0) & (fixes[0] <= t[-1] + 1e-9)
    t_fix, r_fix, v_fix = (part[inside] for part in fixes)
    tick = np.clip(np.rint(t_fix * rate).astype(int), 0, n)
    arm = np.einsum("nij,j->ni", C[tick], lever)
    swing = np.einsum("nij,nj->ni", C[tick], np.cross(w_b[tick], lever))
    path: Any = CubicHermiteSpline(t_fix, r_fix - arm, v_fix - swing)
    t_end = float(min(t[-1], t_fix[-1]))
    n = int(np.floor(t_end * rate + 1e-6))
    t = t[: n + 1]
    dtheta = dtheta[:n]
    dvel = dvel[:n]
    q = q[: n + 1]
    w_b = w_b[: n + 1]
    knots = np.unique(np.append(np.arange(0, n, max(1, round(_KNOTS * rate))), n))
    phase = Phase("log", 0.0, float(t[-1]), path, attitude_spline(t[knots], q[knots]))
    f_b = np.vstack([dvel[:1], dvel]) * rate
    return Trajectory((phase,), {}, theta0, epoch), Reference(t, path(t), path(t, 1), q, f_b, w_b, dtheta, dvel)


def _turned(theta0: float) -> Floats:
    """Return the rotation C_i_e (3, 3) for an Earth rotation angle (rad)."""
    c = np.cos(theta0)
    s = np.sin(theta0)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _accumulated(C: Floats, dtheta: Floats) -> Floats:
    """Return the attitudes C_b_i (n + 1, 3, 3) from the initial attitude C (3, 3) and angle increments (n, 3) rad."""
    steps = Rotation.from_rotvec(dtheta).as_matrix()
    attitudes = np.empty((len(dtheta) + 1, 3, 3))
    attitudes[0] = C
    for k, step in enumerate(steps):
        attitudes[k + 1] = attitudes[k] @ step
    return matrices_of(quaternions(attitudes))


def _on_log(
    prepared: Prepared, fixes: tuple[Floats, Floats, Floats], log: NavigationData, card: NavigationLog
) -> Prepared:
    """Return a prepared case whose IMU and receiver output the contents of the log, without draws."""
    rate = prepared.scenario.imu.rate
    epochs = prepared.sky.t  # times of validity of the measurements
    at = _nearest(fixes[0], epochs)
    matched = np.abs(fixes[0][at] - epochs) < 0.5 / rate
    if np.count_nonzero(matched) < _FEWEST:
        raise InputError(
            f"{np.count_nonzero(matched)} of the case's {epochs.size} epochs, {epoch_interval(prepared.scenario):g} s "
            f"apart, meet a solution of the log to half a tick of its unit, {0.5 / rate:.2g} s"
        )
    signals, unit, ref = prepared.signals, prepared.unit, prepared.reference
    nothing = np.zeros_like
    variance = signals.variance.copy()
    if card.gnss.noise == "log" and not prepared.scenario.filter.tight:
        variance[:, :6] = _variances(log, fixes, at, prepared.trajectory.theta0)
    n_used = np.where(matched, _SATELLITES, 0)
    shared = signals.shared._replace(start=nothing(signals.shared.start), walk=nothing(signals.shared.walk))
    return prepared._replace(
        signals=signals._replace(
            n_used=n_used,
            position=fixes[1][at],
            velocity=fixes[2][at],
            sigma=nothing(signals.sigma),
            variance=variance,
            clock_start=nothing(signals.clock_start),
            clock_step=nothing(signals.clock_step),
            clock_jump=nothing(signals.clock_jump),
            frozen=nothing(signals.frozen),
            shared=shared,
        ),
        unit=unit._replace(
            dtheta=np.ascontiguousarray(ref.dtheta),
            dvel=np.ascontiguousarray(ref.dvel),
            white=nothing(unit.white),
            sigma=nothing(unit.sigma),
            walk=nothing(unit.walk),
            drifting=False,
            **{name: getattr(unit, name)[:0] for name in unit._fields if name.startswith("profile")},
        ),
        start=prepared.start._replace(roots=nothing(prepared.start.roots)),
    )


def _nearest(t: Floats, wanted: Floats) -> Ints:
    """Return the index of the time in t (n,) that is nearest to each wanted time (m,)."""
    after = np.clip(np.searchsorted(t, wanted), 1, t.size - 1)
    return np.where(wanted - t[after - 1] < t[after] - wanted, after - 1, after)


def _variances(log: NavigationData, fixes: tuple[Floats, Floats, Floats], at: Ints, theta0: float) -> Floats:
    """Return the variances (n_epoch, 6) of the log's solutions along the axes of frame i, SI squared."""
    place = log.place[at]
    sigma = log.sigma[at]
    C_n_e = np.swapaxes(rotation_e_n(place[:, 0], place[:, 1]), 1, 2)
    C_n_i = np.stack([_turned(theta).T @ C for theta, C in zip(earth_angle(theta0, fixes[0][at]), C_n_e, strict=True)])
    return np.hstack([np.einsum("nij,nj->ni", C_n_i**2, part**2) for part in (sigma[:, :3], sigma[:, 3:])])
