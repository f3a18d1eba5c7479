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
from lvnav_trade.scenario.filter_models import epoch_interval, filter_measurements, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.simulation.preparation.signals.receiver_measurements import slots
from lvnav_trade.simulation.recorded.alignment import Alignment, interpolated_increments
from lvnav_trade.simulation.recorded.log_consistency import inertial_fixes
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog, Ranges, satellite_name
from lvnav_trade.simulation.recorded.range_consistency import RecordedRanges, check_ranges
from lvnav_trade.trajectory.truth import Phase, Trajectory, attitude_spline

_FLIGHT_TIME = 0.075  # s, signal travel time of a missing range, for a clock correction that is not used
_OBSERVABLES = ("pseudorange", "range_rate")
_NAMED = 6  # largest number of satellites that a note names
_START = 4  # number of satellites of the first epoch, at which the receiver clock is removed


def with_ranges(
    prepared_case: PreparedCase, ranges: Ranges, start: float, fixes: tuple[Floats, Floats, Floats]
) -> tuple[PreparedCase, tuple[str, ...]]:
    """Return a prepared case with the ranges of a log as measurements, and notes on omitted ranges.

    Satellite clocks (from the ephemerides) and the delays in the filter's correction are removed, as in a receiver. So
    are bias and drift of the receiver clock at the first epoch, relative to the solution there. Satellites that the
    case does not track, below the mask, are omitted.

    Parameters
    ----------
    prepared_case
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
    sky = prepared_case.sky
    signals = prepared_case.signals
    measurements = filter_measurements(prepared_case.scenario)
    columns = [column for column, name in enumerate(_OBSERVABLES) if name in measurements]
    measured_ranges = _epoch_ranges(prepared_case, ranges, start)
    is_complete = np.isfinite(measured_ranges[:, :, columns]).all(axis=2)
    is_used = is_complete & sky.is_tracked
    pseudorange = measured_ranges[:, :, 0]
    corrections = _corrections(prepared_case, pseudorange)
    if not (is_used.sum(axis=1) >= _START).any():
        in_case = ", ".join(sorted(set(sky.names))[:8])
        in_log = ", ".join(sorted(set(ranges.satellites))[:8])
        raise InputError(
            f"ranges: at no epoch of the case {_START} satellites that it tracks; it has {in_case}, the log {in_log}"
        )
    recorded_ranges = RecordedRanges(measured_ranges, corrections, is_used, columns)
    is_used, notes = check_ranges(prepared_case, recorded_ranges, ranges.file)
    corrected_ranges = measured_ranges + corrections
    has_start = is_used.sum(axis=1) >= _START
    first = int(np.argmax(has_start))
    bias, drift = _clock(prepared_case, corrected_ranges, is_used, first, fixes)
    time_since_start = (sky.t - sky.t[first])[:, None]
    is_recorded = is_used[:, :, None] & np.isfinite(corrected_ranges)
    clock_bias = bias + drift * time_since_start
    recorded_range = corrected_ranges[:, :, 0] - clock_bias
    recorded_rate = corrected_ranges[:, :, 1] - drift
    satellite_by_slot, n_used = slots(is_used)
    recorded_signals = signals._replace(
        satellite_by_slot=satellite_by_slot,
        n_used=n_used,
        range=np.where(is_recorded[:, :, 0], recorded_range, signals.range),
        rate=np.where(is_recorded[:, :, 1], recorded_rate, signals.rate),
    )
    with_log = prepared_case._replace(signals=recorded_signals)
    return with_log, (*_unknown_satellites_note(prepared_case, ranges), *notes)


def _unknown_satellites_note(prepared_case: PreparedCase, ranges: Ranges) -> tuple[str, ...]:
    """Return a note on satellites of the log that the constellation of the case lacks; empty if there are none."""
    constellation = {satellite_name(name) for name in prepared_case.sky.names}
    counts = Counter(name for name in ranges.satellites if name not in constellation)
    if not counts:
        return ()
    first_counts = sorted(counts.items())[:_NAMED]
    satellite_list = ", ".join(f"{name} ({count})" for name, count in first_counts)
    ellipsis = ", ..." if len(counts) > _NAMED else ""
    return (f"rows of {len(counts)} satellites that the constellation lacks are left out: {satellite_list}{ellipsis}",)


def _epoch_ranges(prepared_case: PreparedCase, ranges: Ranges, start: float) -> Floats:
    """Return the ranges of a log by epoch and satellite of the case, (n_epoch, n_sat, 2) m and m/s; NaN if missing."""
    number = {satellite_name(name): k for k, name in enumerate(prepared_case.sky.names)}
    t_epoch = prepared_case.sky.t  # times of validity of the measurements
    t = ranges.t - start
    intervals_since_first = (t - t_epoch[0]) / prepared_case.signals.interval
    nearest = np.rint(intervals_since_first).astype(int)
    epoch = np.clip(nearest, 0, t_epoch.size - 1)
    time_to_epoch = np.abs(t - t_epoch[epoch])
    half_tick = 0.5 * prepared_case.unit.dt
    is_at_epoch = time_to_epoch < half_tick
    n_sat = len(prepared_case.sky.names)
    measured_ranges = np.full((t_epoch.size, n_sat, 2), np.nan)
    for row in np.flatnonzero(is_at_epoch).tolist():
        satellite = ranges.satellites[row]
        if satellite in number:
            measured_ranges[epoch[row], number[satellite]] = ranges.values[row]
    return measured_ranges


def _corrections(prepared_case: PreparedCase, pseudorange: Floats) -> Floats:
    """Return the corrections added to ranges and rates (n_epoch, n_sat, 2): satellite clocks minus modelled delays."""
    scenario = prepared_case.scenario
    orbits = satellites(scenario.constellation, scenario.trajectory.epoch)
    travel_time = np.where(np.isfinite(pseudorange), pseudorange / SPEED_OF_LIGHT, _FLIGHT_TIME)
    transmission_time = prepared_case.sky.t[:, None] - travel_time
    one_second_later = transmission_time + 1.0
    clock = orbits.clock(transmission_time) + orbits.relativity(transmission_time)
    clock_later = orbits.clock(one_second_later) + orbits.relativity(one_second_later)
    clock_range = SPEED_OF_LIGHT * clock
    clock_rate = SPEED_OF_LIGHT * (clock_later - clock)
    satellite_clock = np.stack([clock_range, clock_rate], axis=2)
    delays = prepared_case.atmospheric_delays
    modelled_delay = delays.modelled_troposphere + delays.modelled_ionosphere
    return satellite_clock - modelled_delay


def _clock(
    prepared_case: PreparedCase,
    corrected_ranges: Floats,
    is_used: Bools,
    epoch: int,
    fixes: tuple[Floats, Floats, Floats],
) -> Floats:
    """Return bias (m) and drift (m/s) of the receiver clock at an epoch, (2,): medians over the satellites.

    Parameters
    ----------
    prepared_case
        Prepared case.
    corrected_ranges
        (n_epoch, n_sat, 2) m, m/s. Corrected ranges and range rates.
    is_used
        (n_epoch, n_sat). Whether they are used.
    epoch
        Index of the epoch.
    fixes
        Times (n,) s, positions (n, 3) m and velocities (n, 3) m/s of the solutions, frame i.
    """
    t_fix, r_i, v_i = fixes
    sky = prepared_case.sky
    time_to_fixes = np.abs(t_fix - sky.t[epoch])
    nearest = int(np.argmin(time_to_fixes))
    selection = is_used[epoch]
    relative_position = sky.r_i[epoch, selection] - r_i[nearest]
    relative_velocity = sky.v_i[epoch, selection] - v_i[nearest]
    line = sight(relative_position, relative_velocity)
    predicted_ranges = np.stack([line.distance, line.rate], axis=1)
    clock_errors = corrected_ranges[epoch, selection] - predicted_ranges
    return np.median(clock_errors, axis=0)


_SOLUTION = {"position", "velocity"}
_RANGES = {"pseudorange", "range_rate"}
_FEWEST = 10  # smallest number of solutions for a replay
_KNOTS = 0.1  # s between knots of the reference attitude
_SATELLITES = 4  # number of satellites that marks an epoch with a solution


def refuse_unable(scenario: Scenario, card: NavigationLog) -> None:
    """Raise InputError if the filter of a case needs measurements that a log lacks."""
    available = _SOLUTION | (_RANGES if card.ranges is not None else set())
    lacking = [name for name in filter_measurements(scenario) if name not in available]
    if lacking or not filter_measurements(scenario):
        measurement_list = ", ".join(lacking) or "no measurement"
        raise InputError(f"the filter takes {measurement_list}; the log has {', '.join(sorted(available))}")
    if not isinstance(scenario.imu, ImuCard):
        raise InputError("imu: the log is of one IMU, but the campaign has several")
    if has_receiver_solution(scenario):
        raise InputError("receiver.solution: solved from simulated ranges; a log has the solution (kind: direct)")
    if scenario.receiver.antennas and len(scenario.receiver.antennas) > 1:
        raise InputError("receiver: the log is of one antenna, but the campaign has several")


class LogReplay(NamedTuple):
    """Case prepared for a replay of a log.

    prepared_case : Prepared case.
    notes : Notes on omitted parts of the log.
    """

    prepared_case: PreparedCase
    notes: tuple[str, ...] = ()


def log_replay(scenario: Scenario, log: NavigationData, card: NavigationLog, alignment: Alignment) -> LogReplay:
    """Return a case prepared for a replay of a log, from the end of its rest on.

    The truth side is the log: its increments without further errors, the receiver's solutions, and the path through
    them as reference. Nothing is drawn. Time counts from the first solution after the rest.

    Parameters
    ----------
    scenario
        Validated model of the case.
    log, card
        Recorded log, and its card.
    alignment
        Alignment at the end of the rest.

    Raises
    ------
    InputError
        If the log has fewer IMU rows per second than the case, or if its solutions are not at epochs of the case.
    """
    refuse_unable(scenario, card)
    rate = scenario.imu.rate
    is_after_rest = log.t_fix >= alignment.t
    first = int(np.argmax(is_after_rest))
    start = float(log.t_fix[first])
    end = float(min(log.t_fix[-1], log.t[-1]))
    log_length = float(log.t[-1] - log.t[0])
    log_rate = (log.t.size - 1) / log_length
    if rate > 1.5 * log_rate:
        raise InputError(f"imu.rate: {rate:g} Hz; the log has {log_rate:.4g} rows a second")
    epoch = utc_after(log.epoch, start)
    trajectory_card = scenario.trajectory.model_copy(update={"epoch": epoch})
    scenario = scenario.model_copy(update={"trajectory": trajectory_card, "faults": ()})
    lever = np.array(scenario.receiver.lever_b)
    theta0 = gmst(epoch)
    fixes = inertial_fixes(log, start, theta0)
    flight = _reference(scenario, log, alignment, fixes, lever, (start, end), epoch)
    prepared_case = prepare(scenario, epoch_interval(scenario), given_flight=flight)
    prepared_case = _log_case(prepared_case, fixes, log, card)
    if log.ranges is None or not scenario.filter.tight:
        return LogReplay(prepared_case)
    with_log, notes = with_ranges(prepared_case, log.ranges, start, fixes)
    return LogReplay(with_log, notes)


def _reference(
    scenario: Scenario,
    log: NavigationData,
    alignment: Alignment,
    fixes: tuple[Floats, Floats, Floats],
    lever: Floats,
    span: tuple[float, float],
    epoch: str,
) -> tuple[Trajectory, Reference]:
    """Return the path of the IMU through the solutions, and its increments on the ticks of the case."""
    rate = scenario.imu.rate
    start, end = span
    length = end - start
    n = int(np.floor(length * rate + 1e-6))
    t = np.arange(n + 1) / rate
    t_log = start + t
    angle_sums = interpolated_increments(log, t_log, log.angle_sums)
    velocity_sums = interpolated_increments(log, t_log, log.velocity_sums)
    dtheta = np.diff(angle_sums, axis=0) - alignment.gyro_bias / rate
    dvel = np.diff(velocity_sums, axis=0)
    theta0 = gmst(epoch)
    is_after_start = log.t_fix >= start
    first = int(np.argmax(is_after_start))
    latitude = log.place[first, 0]
    longitude = log.place[first, 1]
    C_i_n = rotation_e_n(latitude, longitude) @ _earth_rotation(theta0)
    # the body is assumed at rest between the end of the rest and the first solution, a fraction of a second
    initial_C_b_i = C_i_n.T @ alignment.C_b_n
    C = _attitudes(initial_C_b_i, dtheta)
    w_b = np.vstack([dtheta[:1], dtheta]) * rate
    path = _imu_path(fixes, t, rate, C, w_b, lever)
    # from here on only the ticks up to the last solution
    last_time = float(min(t[-1], path.x[-1]))
    n = int(np.floor(last_time * rate + 1e-6))
    t = t[: n + 1]
    q = quaternions(C)[: n + 1]
    dtheta = dtheta[:n]
    dvel = dvel[:n]
    ticks_per_knot = max(1, round(_KNOTS * rate))
    regular_knots = np.arange(0, n, ticks_per_knot)
    knots = np.unique(np.append(regular_knots, n))
    attitude = attitude_spline(t[knots], q[knots])
    phase = Phase("log", 0.0, float(t[-1]), path, attitude)
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
    x_axis = [c, s, 0.0]
    y_axis = [-s, c, 0.0]
    z_axis = [0.0, 0.0, 1.0]
    return np.array([x_axis, y_axis, z_axis])


def _attitudes(C: Floats, dtheta: Floats) -> Floats:
    """Return the attitudes C_b_i (n + 1, 3, 3) from the initial attitude C (3, 3) and angle increments (n, 3) rad."""
    steps = Rotation.from_rotvec(dtheta).as_matrix()
    n_attitude = len(dtheta) + 1
    attitudes = np.empty((n_attitude, 3, 3))
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
    is_inside = (t_fix >= 0.0) & (t_fix <= t[-1] + 1e-9)
    t_fix = t_fix[is_inside]
    nearest_tick = np.rint(t_fix * rate).astype(int)
    tick = np.clip(nearest_tick, 0, t.size - 1)
    attitude = C_b_i[tick]
    lever_velocity_b = np.cross(w_b[tick], lever)
    lever_i = np.einsum("nij,j->ni", attitude, lever)
    lever_velocity_i = np.einsum("nij,nj->ni", attitude, lever_velocity_b)
    position = r_i[is_inside] - lever_i
    velocity = v_i[is_inside] - lever_velocity_i
    return CubicHermiteSpline(t_fix, position, velocity)


def _log_case(
    prepared_case: PreparedCase, fixes: tuple[Floats, Floats, Floats], log: NavigationData, card: NavigationLog
) -> PreparedCase:
    """Return a prepared case whose IMU and receiver output the contents of the log, without draws."""
    scenario = prepared_case.scenario
    half_tick = 0.5 / scenario.imu.rate
    t_fix, r_i, v_i = fixes
    epochs = prepared_case.sky.t  # times of validity of the measurements
    nearest = _nearest(t_fix, epochs)
    is_matched = np.abs(t_fix[nearest] - epochs) < half_tick
    n_matched = np.count_nonzero(is_matched)
    if n_matched < _FEWEST:
        raise InputError(
            f"{n_matched} of the case's {epochs.size} epochs, {epoch_interval(scenario):g} s apart, meet a solution of "
            f"the log to half a tick of its unit, {half_tick:.2g} s"
        )
    signals, unit, ref = prepared_case.signals, prepared_case.unit, prepared_case.reference
    variance = signals.variance.copy()
    if card.gnss.noise == "log" and not scenario.filter.tight:
        variance[:, :6] = _variances(log, fixes, nearest, prepared_case.trajectory.theta0)
    correlated_errors = signals.correlated_errors
    recorded_signals = signals._replace(
        n_used=np.where(is_matched, _SATELLITES, 0),
        position=r_i[nearest],
        velocity=v_i[nearest],
        sigma=np.zeros_like(signals.sigma),
        variance=variance,
        clock_start=np.zeros_like(signals.clock_start),
        clock_step=np.zeros_like(signals.clock_step),
        clock_jump=np.zeros_like(signals.clock_jump),
        is_frozen=np.zeros_like(signals.is_frozen),
        correlated_errors=correlated_errors._replace(
            initial_sigma=np.zeros_like(correlated_errors.initial_sigma), walk=np.zeros_like(correlated_errors.walk)
        ),
    )
    no_profiles = {name: getattr(unit, name)[:0] for name in unit._fields if name.startswith("profile")}
    recorded_unit = unit._replace(
        dtheta=np.ascontiguousarray(ref.dtheta),
        dvel=np.ascontiguousarray(ref.dvel),
        white=np.zeros_like(unit.white),
        sigma=np.zeros_like(unit.sigma),
        walk=np.zeros_like(unit.walk),
        is_drifting=False,
        **no_profiles,
    )
    start = prepared_case.initial_state._replace(roots=np.zeros_like(prepared_case.initial_state.roots))
    return prepared_case._replace(signals=recorded_signals, unit=recorded_unit, initial_state=start)


def _nearest(t: Floats, t_wanted: Floats) -> Ints:
    """Return the index of the time in t (n,) that is nearest to each of the times t_wanted (m,)."""
    insertion = np.searchsorted(t, t_wanted)
    next_index = np.clip(insertion, 1, t.size - 1)
    previous_index = next_index - 1
    time_since_before = t_wanted - t[previous_index]
    time_to_after = t[next_index] - t_wanted
    is_before_nearer = time_since_before < time_to_after
    return np.where(is_before_nearer, previous_index, next_index)


def _variances(log: NavigationData, fixes: tuple[Floats, Floats, Floats], nearest: Ints, theta0: float) -> Floats:
    """Return the variances (n_epoch, 6) of the log's solutions along the axes of frame i, SI squared.

    nearest : (n_epoch,). Solution of each epoch.
    """
    t_fix, _, _ = fixes
    place = log.place[nearest]
    variance_n = log.sigma[nearest] ** 2
    latitude = place[:, 0]
    longitude = place[:, 1]
    C_e_n = rotation_e_n(latitude, longitude)
    C_n_e = np.swapaxes(C_e_n, 1, 2)
    angles = earth_angle(theta0, t_fix[nearest])
    rotations = [_earth_rotation(angle).T @ C for angle, C in zip(angles, C_n_e, strict=True)]
    C_n_i = np.stack(rotations)
    shares = C_n_i**2
    position = np.einsum("nij,nj->ni", shares, variance_n[:, :3])
    velocity = np.einsum("nij,nj->ni", shares, variance_n[:, 3:])
    return np.hstack([position, velocity])
