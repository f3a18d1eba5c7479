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
from lvnav_trade.simulation.recorded.log_consistency import inertial_fixes
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog, Ranges, satellite_name
from lvnav_trade.simulation.recorded.range_consistency import RecordedRanges, compared
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
    sky = prepared.sky
    signals = prepared.signals
    measurements = measured(prepared.scenario)
    needed = [column for column, name in enumerate(_OBSERVABLES) if name in measurements]
    observed = _epoch_ranges(prepared, ranges, start)
    tracked = np.isfinite(observed[:, :, needed]).all(axis=2) & sky.tracked
    corrections = _corrections(prepared, observed[:, :, 0])
    if not (tracked.sum(axis=1) >= _START).any():
        in_case = ", ".join(sorted(set(sky.names))[:8])
        in_log = ", ".join(sorted(set(ranges.satellites))[:8])
        raise InputError(
            f"ranges: at no epoch of the case {_START} satellites that it tracks; it has {in_case}, the log {in_log}"
        )
    tracked, notes = compared(prepared, RecordedRanges(observed, corrections, tracked, needed), ranges.file)
    corrected = observed + corrections
    first = int(np.argmax(tracked.sum(axis=1) >= _START))
    bias, drift = _clock(prepared, corrected, tracked, first, fixes)
    since = (sky.t - sky.t[first])[:, None]
    is_recorded = tracked[:, :, None] & np.isfinite(corrected)
    recorded_range = corrected[:, :, 0] - (bias + drift * since)
    recorded_rate = corrected[:, :, 1] - drift
    used, n_used = slots(tracked)
    recorded_signals = signals._replace(
        used=used,
        n_used=n_used,
        range=np.where(is_recorded[:, :, 0], recorded_range, signals.range),
        rate=np.where(is_recorded[:, :, 1], recorded_rate, signals.rate),
    )
    return prepared._replace(signals=recorded_signals), (*_strangers(prepared, ranges), *notes)


def _strangers(prepared: Prepared, ranges: Ranges) -> tuple[str, ...]:
    """Return a note on satellites of the log that the constellation of the case lacks; empty if there are none."""
    constellation = {satellite_name(name) for name in prepared.sky.names}
    counts = Counter(name for name in ranges.satellites if name not in constellation)
    if not counts:
        return ()
    first_counts = sorted(counts.items())[:_NAMED]
    named = ", ".join(f"{name} ({count})" for name, count in first_counts)
    more = ", ..." if len(counts) > _NAMED else ""
    return (f"rows of {len(counts)} satellites that the constellation lacks are left out: {named}{more}",)


def _epoch_ranges(prepared: Prepared, ranges: Ranges, start: float) -> Floats:
    """Return the ranges of a log by epoch and satellite of the case, (n_epoch, n_sat, 2) m and m/s; NaN if missing."""
    number = {satellite_name(name): k for k, name in enumerate(prepared.sky.names)}
    t_epoch = prepared.sky.t  # times of validity of the measurements
    t = ranges.t - start
    nearest = np.rint((t - t_epoch[0]) / prepared.signals.interval).astype(int)
    epoch = np.clip(nearest, 0, t_epoch.size - 1)
    is_at_epoch = np.abs(t - t_epoch[epoch]) < 0.5 * prepared.unit.dt
    observed = np.full((t_epoch.size, len(prepared.sky.names), 2), np.nan)
    for row in np.flatnonzero(is_at_epoch).tolist():
        satellite = ranges.satellites[row]
        if satellite in number:
            observed[epoch[row], number[satellite]] = ranges.values[row]
    return observed


def _corrections(prepared: Prepared, pseudorange: Floats) -> Floats:
    """Return the corrections added to ranges and rates (n_epoch, n_sat, 2): satellite clocks minus modelled delays."""
    scenario = prepared.scenario
    orbits = satellites(scenario.constellation, scenario.trajectory.epoch)
    travel_time = np.where(np.isfinite(pseudorange), pseudorange / SPEED_OF_LIGHT, _FLIGHT_TIME)
    sent = prepared.sky.t[:, None] - travel_time
    clock = orbits.clock(sent) + orbits.relativity(sent)
    clock_later = orbits.clock(sent + 1.0) + orbits.relativity(sent + 1.0)
    satellite_clock = np.stack([SPEED_OF_LIGHT * clock, SPEED_OF_LIGHT * (clock_later - clock)], axis=2)
    modelled = prepared.delays.modelled_troposphere + prepared.delays.modelled_ionosphere
    return satellite_clock - modelled


def _clock(
    prepared: Prepared,
    corrected: Floats,
    tracked: Bools,
    epoch: int,
    fixes: tuple[Floats, Floats, Floats],
) -> Floats:
    """Return bias (m) and drift (m/s) of the receiver clock at an epoch, (2,): medians over the satellites.

    Parameters
    ----------
    prepared
        Prepared case.
    corrected
        (n_epoch, n_sat, 2) m, m/s. Corrected ranges and range rates.
    tracked
        (n_epoch, n_sat). Whether they are used.
    epoch
        Index of the epoch.
    fixes
        Times (n,) s, positions (n, 3) m and velocities (n, 3) m/s of the solutions, frame i.
    """
    t_fix, r_i, v_i = fixes
    sky = prepared.sky
    nearest = int(np.argmin(np.abs(t_fix - sky.t[epoch])))
    is_tracked = tracked[epoch]
    line = sight(sky.r_i[epoch, is_tracked] - r_i[nearest], sky.v_i[epoch, is_tracked] - v_i[nearest])
    expected = np.stack([line.distance, line.rate], axis=1)
    return np.median(corrected[epoch, is_tracked] - expected, axis=0)


_SOLUTION = {"position", "velocity"}
_RANGES = {"pseudorange", "range_rate"}
_FEWEST = 10  # smallest number of solutions for a replay
_KNOTS = 0.1  # s between knots of the reference attitude
_SATELLITES = 4  # number of satellites that marks an epoch with a solution


def refuse_unable(scenario: Scenario, card: NavigationLog) -> None:
    """Raise InputError if the filter of a case needs measurements that a log lacks."""
    available = _SOLUTION | (_RANGES if card.ranges is not None else set())
    lacking = [name for name in measured(scenario) if name not in available]
    if lacking or not measured(scenario):
        processed = ", ".join(lacking) or "no measurement"
        raise InputError(f"the filter takes {processed}; the log has {', '.join(sorted(available))}")
    if not isinstance(scenario.imu, ImuCard):
        raise InputError("imu: the log is of one IMU, but the campaign has several")
    if solves(scenario):
        raise InputError("receiver.solution: solved from simulated ranges; a log has the solution (kind: direct)")
    if scenario.receiver.antennas and len(scenario.receiver.antennas) > 1:
        raise InputError("receiver: the log is of one antenna, but the campaign has several")


class LogReplay(NamedTuple):
    """Case prepared for a replay of a log.

    prepared : Prepared case.
    notes : Notes on omitted parts of the log.
    """

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
    trajectory_card = scenario.trajectory.model_copy(update={"epoch": epoch})
    scenario = scenario.model_copy(update={"trajectory": trajectory_card, "faults": ()})
    lever = np.array(scenario.receiver.lever_b)
    fixes = inertial_fixes(log, start, gmst(epoch))
    trajectory, reference = _reference(scenario, log, aligned, fixes, lever, (start, end), epoch)
    prepared = prepare(scenario, epoch_interval(scenario), flown=(trajectory, reference))
    prepared = _on_log(prepared, fixes, log, card)
    if log.ranges is None or not scenario.filter.tight:
        return LogReplay(prepared)
    with_log, notes = with_ranges(prepared, log.ranges, start, fixes)
    return LogReplay(with_log, notes)


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
    rate = scenario.imu.rate
    start, end = span
    n = int(np.floor((end - start) * rate + 1e-6))
    t = np.arange(n + 1) / rate
    dtheta = np.diff(increments_to(log, start + t, log.turned), axis=0) - aligned.gyro_bias / rate
    dvel = np.diff(increments_to(log, start + t, log.pushed), axis=0)
    theta0 = gmst(epoch)
    first = int(np.argmax(log.t_fix >= start))
    C_i_n = rotation_e_n(log.place[first, 0], log.place[first, 1]) @ _earth_rotation(theta0)
    # the body is assumed at rest between the end of the rest and the first solution, a fraction of a second
    C = _attitudes(C_i_n.T @ aligned.C_b_n, dtheta)
    w_b = np.vstack([dtheta[:1], dtheta]) * rate
    path = _imu_path(fixes, t, rate, C, w_b, lever)
    # from here on only the ticks up to the last solution
    n = int(np.floor(float(min(t[-1], path.x[-1])) * rate + 1e-6))
    t = t[: n + 1]
    q = quaternions(C)[: n + 1]
    dtheta = dtheta[:n]
    dvel = dvel[:n]
    knots = np.unique(np.append(np.arange(0, n, max(1, round(_KNOTS * rate))), n))
    phase = Phase("log", 0.0, float(t[-1]), path, attitude_spline(t[knots], q[knots]))
    reference = Reference(
        t=t,
        r_i=path(t),
        v_i=path(t, 1),
        q_b_i=q,
        f_b=np.vstack([dvel[:1], dvel]) * rate,
        w_ib_b=w_b[: n + 1],
        dtheta=dtheta,
        dvel=dvel,
    )
    return Trajectory((phase,), {}, theta0, epoch), reference


def _earth_rotation(theta0: float) -> Floats:
    """Return the rotation C_i_e (3, 3) for an Earth rotation angle (rad)."""
    c = np.cos(theta0)
    s = np.sin(theta0)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _attitudes(C: Floats, dtheta: Floats) -> Floats:
    """Return the attitudes C_b_i (n + 1, 3, 3) from the initial attitude C (3, 3) and angle increments (n, 3) rad."""
    steps = Rotation.from_rotvec(dtheta).as_matrix()
    attitudes = np.empty((len(dtheta) + 1, 3, 3))
    attitudes[0] = C
    for k, step in enumerate(steps):
        attitudes[k + 1] = attitudes[k] @ step
    return matrices_of(quaternions(attitudes))


def _imu_path(
    fixes: tuple[Floats, Floats, Floats],
    t: Floats,
    rate: float,
    C_b_i: Floats,
    w_b: Floats,
    lever: Floats,
) -> Any:
    """Return the path of the IMU (a spline of position, frame i) through the solutions within the times t (n,) s.

    rate : Hz. Rate of the times.
    C_b_i : (n, 3, 3). Attitudes.
    w_b : (n, 3) rad/s. Body rates.
    lever : (3,) m. From the IMU to the antenna, body axes.
    """
    t_fix, r_i, v_i = fixes
    inside = (t_fix >= 0.0) & (t_fix <= t[-1] + 1e-9)
    t_fix = t_fix[inside]
    tick = np.clip(np.rint(t_fix * rate).astype(int), 0, t.size - 1)
    arm = np.einsum("nij,j->ni", C_b_i[tick], lever)
    arm_velocity = np.einsum("nij,nj->ni", C_b_i[tick], np.cross(w_b[tick], lever))
    return CubicHermiteSpline(t_fix, r_i[inside] - arm, v_i[inside] - arm_velocity)


def _on_log(
    prepared: Prepared, fixes: tuple[Floats, Floats, Floats], log: NavigationData, card: NavigationLog
) -> Prepared:
    """Return a prepared case whose IMU and receiver output the contents of the log, without draws."""
    scenario = prepared.scenario
    half_tick = 0.5 / scenario.imu.rate
    t_fix, r_i, v_i = fixes
    epochs = prepared.sky.t  # times of validity of the measurements
    nearest = _nearest(t_fix, epochs)
    matched = np.abs(t_fix[nearest] - epochs) < half_tick
    if np.count_nonzero(matched) < _FEWEST:
        raise InputError(
            f"{np.count_nonzero(matched)} of the case's {epochs.size} epochs, {epoch_interval(scenario):g} s "
            f"apart, meet a solution of the log to half a tick of its unit, {half_tick:.2g} s"
        )
    signals, unit, ref = prepared.signals, prepared.unit, prepared.reference
    variance = signals.variance.copy()
    if card.gnss.noise == "log" and not scenario.filter.tight:
        variance[:, :6] = _variances(log, fixes, nearest, prepared.trajectory.theta0)
    shared = signals.shared
    recorded_signals = signals._replace(
        n_used=np.where(matched, _SATELLITES, 0),
        position=r_i[nearest],
        velocity=v_i[nearest],
        sigma=np.zeros_like(signals.sigma),
        variance=variance,
        clock_start=np.zeros_like(signals.clock_start),
        clock_step=np.zeros_like(signals.clock_step),
        clock_jump=np.zeros_like(signals.clock_jump),
        frozen=np.zeros_like(signals.frozen),
        shared=shared._replace(start=np.zeros_like(shared.start), walk=np.zeros_like(shared.walk)),
    )
    no_profiles = {name: getattr(unit, name)[:0] for name in unit._fields if name.startswith("profile")}
    recorded_unit = unit._replace(
        dtheta=np.ascontiguousarray(ref.dtheta),
        dvel=np.ascontiguousarray(ref.dvel),
        white=np.zeros_like(unit.white),
        sigma=np.zeros_like(unit.sigma),
        walk=np.zeros_like(unit.walk),
        drifting=False,
        **no_profiles,
    )
    start = prepared.start._replace(roots=np.zeros_like(prepared.start.roots))
    return prepared._replace(signals=recorded_signals, unit=recorded_unit, start=start)


def _nearest(t: Floats, t_wanted: Floats) -> Ints:
    """Return the index of the time in t (n,) that is nearest to each of the times t_wanted (m,)."""
    after = np.clip(np.searchsorted(t, t_wanted), 1, t.size - 1)
    is_before_nearer = t_wanted - t[after - 1] < t[after] - t_wanted
    return np.where(is_before_nearer, after - 1, after)


def _variances(log: NavigationData, fixes: tuple[Floats, Floats, Floats], nearest: Ints, theta0: float) -> Floats:
    """Return the variances (n_epoch, 6) of the log's solutions along the axes of frame i, SI squared.

    nearest : (n_epoch,). Solution of each epoch.
    """
    t_fix, _, _ = fixes
    place = log.place[nearest]
    variance_n = log.sigma[nearest] ** 2
    C_n_e = np.swapaxes(rotation_e_n(place[:, 0], place[:, 1]), 1, 2)
    angles = earth_angle(theta0, t_fix[nearest])
    C_n_i = np.stack([_earth_rotation(angle).T @ C for angle, C in zip(angles, C_n_e, strict=True)])
    position = np.einsum("nij,nj->ni", C_n_i**2, variance_n[:, :3])
    velocity = np.einsum("nij,nj->ni", C_n_i**2, variance_n[:, 3:])
    return np.hstack([position, velocity])
