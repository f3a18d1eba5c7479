"""True trajectory from a user's file: splines through its rows, jumps of the reference point, contradictions."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    eci_from_ecef,
    matrices,
    quaternions,
    unit,
)
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.trajectory.ascent.launch import achieved_orbit
from lvnav_trade.trajectory.ascent.plausibility import add_limit_remarks
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY
from lvnav_trade.trajectory.discontinuities import suggested_events
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.contradiction import Residual
from lvnav_trade.trajectory.files.first_rows import (
    REST,
    axes_remark,
    clock_remark,
    compare_interpretations,
    interpretation_warning,
)
from lvnav_trade.trajectory.files.row_checks import SAME
from lvnav_trade.trajectory.files.row_fit import (
    COARSEST,
    RowFit,
    angles_between,
    attitude_fit,
    event_marks,
    mean_forces,
    path_forces,
    row_fit,
)
from lvnav_trade.trajectory.files.rows import read_rows
from lvnav_trade.trajectory.files.splines import path_attitude
from lvnav_trade.trajectory.truth import NOTE, PAD_STEP, WARNING, Phase, Trajectory, motion, pad_phase, pad_times

_CLOSEST = 0.1  # s; smallest interval of the samples at rest before the rows


def build_table_flight(card: TableTrajectory) -> Trajectory:
    """Return the true trajectory of a user's file.

    Raises
    ------
    InputError
        The file cannot be read or contradicts itself grossly, an event lies outside it, or the flight exceeds a limit
        of the card.
    """
    path = row_fit(card)
    rows, edges, hold = path.rows, path.edges, card.pad_hold
    first_r, first_v = path.position(edges[0]), path.position(edges[0], 1)
    speed = float(np.linalg.norm(earth_velocity(first_r, first_v)))
    if hold > 0.0 and speed > REST:  # only a file that begins at rest can have a pad before it
        raise InputError(
            f"{card.file}: the first row moves at {speed:.3g} m/s over the Earth, so it is not on a pad: set pad_hold "
            f"to 0 s"
        )
    try:
        attitude = _attitude(card, path, hold)
    except InputError as error:
        raise InputError(f"{card.file}: {error}") from None
    pad_e = ecef_from_eci(first_r, earth_angle(rows.theta0, edges[0]))
    phases = [*pad_phase(pad_e, rows.theta0, edges[0], hold, attitude, v_end=first_v)]
    marks = event_marks(card.events, rows.t)
    for begin, end in pairwise(edges):
        names = [name for name, time in marks.items() if abs(time - begin) < SAME]
        name = names[0] if names else "start"
        phase = Phase(
            name=f"from {name}",
            start=begin,
            end=end,
            position=path.position,
            attitude=attitude,
        )
        phases.append(phase)
    flight = Trajectory(
        phases=tuple(phases),
        events=_flight_events(marks, card.events),
        theta0=rows.theta0,
        epoch=card.epoch,
    )
    warnings = [
        path.event_warning,
        clock_remark(card, rows),
        axes_remark(card, rows),
        _interpretation_remark(card, path),
    ]
    flight = flight.add_remarks(NOTE, rows.notes).add_remarks(WARNING, [text for text in warnings if text])
    flight = add_limit_remarks(flight, card, card.file)
    flight.facts.update(_facts(card, path, flight))
    return flight


def _interpretation_remark(card: TableTrajectory, path: RowFit) -> str:
    """Return the warning that another interpretation of the attitude fits the forces better; empty without attitude.

    InputError as in `interpretation_warning`.
    """
    rows = path.rows
    if rows.q_b_i is None:
        return ""
    gravity = gravity_along(path.position(rows.t))
    force = path.position(rows.t, 2) - gravity
    is_strong = np.linalg.norm(force, axis=1) > STANDARD_GRAVITY
    return interpretation_warning(card, compare_interpretations(card, rows.r_i, force, is_strong))


def missing_events_warning(card: TableTrajectory) -> str:
    """Return the warning about events that jumps of force suggest and the card does not declare; empty for none."""
    return row_fit(card).event_warning


def suggest_file_events(card: TableTrajectory) -> dict[str, str]:
    """Return names and times of the events that a file suggests, in order of time.

    They are jumps of the specific force, and the events of the card, at which the file has two different rows.
    """
    rows = read_rows(card)
    t, force, noise = mean_forces(rows)
    marks = event_marks({}, rows.t)
    events = suggested_events(t, force, marks, COARSEST, noise)
    interval = float(np.median(np.diff(rows.t)))
    tolerance = 2.0 * interval
    for number, time in enumerate(card.events.values(), start=1):
        name = f"two_states_{number}"
        for jump, jump_time in events.items():
            if abs(parse(jump_time, "s") - time) < tolerance:
                name = jump
                break
        events[name] = f"{time!r} s"
    return dict(sorted(events.items(), key=lambda event: parse(event[1], "s")))


def is_at_rest(card: TableTrajectory) -> bool:
    """Whether the first row is at rest on the Earth, so that time on the pad may precede it."""
    rows = read_rows(card)
    if rows.v_i is None:
        interval = rows.t[1] - rows.t[0]
        v_i = (rows.r_i[1] - rows.r_i[0]) / interval
    else:
        v_i = rows.v_i[0]
    ground_velocity = earth_velocity(rows.r_i[0], v_i)
    return float(np.linalg.norm(ground_velocity)) <= REST


def residuals(card: TableTrajectory) -> tuple[Residual, ...]:
    """Return the worst contradiction of each part of a file between events; none for a file of positions only."""
    return row_fit(card).residuals


def _flight_events(marks: Mapping[str, float], events: Mapping[str, float]) -> dict[str, float]:
    """Return the events of the flight. Start and end of the file are omitted at the time of another event."""
    event_times = list(events.values())
    if "liftoff" in marks:
        event_times.append(marks["liftoff"])
    flight_events = {}
    for name, mark in marks.items():
        is_end = name in ("start", "end")
        if not (is_end and any(abs(mark - time) < SAME for time in event_times)):
            flight_events[name] = mark
    return flight_events


def _attitude(card: TableTrajectory, path: RowFit, hold: float) -> BSpline:
    """Return the quaternion spline through the rows of attitude, or else along the path.

    path : fit of the rows
    hold : s. Duration at rest on the pad before the first row.
    """
    rows = path.rows
    if rows.q_b_i is None:
        return path_attitude(path.position, path.edges, rows.theta0, card.pointing, card.roll, hold)
    t, q = rows.t, rows.q_b_i
    if hold > 0.0:
        # same interval as the rows, because the roughness of the spline is weighted by it
        interval = float(np.median(np.diff(t)))
        step = min(PAD_STEP, max(_CLOSEST, interval))
        pad_t = pad_times(t[0], hold, step)[:-1]
        # the body's axes, by rows, turn with the Earth
        first_theta = earth_angle(rows.theta0, t[0])
        pad_theta = earth_angle(rows.theta0, pad_t)
        axes_e = ecef_from_eci(matrices(q[0]).T, first_theta)
        pad_axes = np.stack([eci_from_ecef(axis, pad_theta) for axis in axes_e], axis=-1)
        t = np.concatenate([pad_t, t])
        row_axes = matrices(q)
        q = quaternions(np.concatenate([pad_axes, row_axes]))
    return attitude_fit(rows, t, q)


def _facts(card: TableTrajectory, path: RowFit, flight: Trajectory) -> dict[str, float | str]:
    """Return the facts for the report on the file and its fit, SI; InputError as in `_attitude_facts`."""
    t, force = path_forces(path)
    jerk = np.linalg.norm(path.position(t, 3), axis=1)
    load = np.linalg.norm(force, axis=1)
    end = path.edges[-1]
    final_state = np.concatenate([path.position(end), path.position(end, 1)])
    facts: dict[str, float | str] = {
        "file": card.source,
        **achieved_orbit(final_state),
        "max_load_g": float(np.max(load)) / STANDARD_GRAVITY,
        "implied_jerk_worst_m_s3": float(np.max(jerk)),
        "implied_jerk_worst_at_s": float(t[np.argmax(jerk)]),
        "position_misfit_rms_m": path.misfit[0],
        "position_misfit_worst_m": path.misfit[1],
        "position_misfit_worst_at_s": path.misfit[2],
    }
    for number, jump in enumerate(path.jumps, start=1):
        change = f"reference_change_{number}"
        facts[change] = jump.name
        facts[f"{change}_at_s"] = jump.time
        facts[f"{change}_m"] = float(np.linalg.norm(jump.shift))
    for quantity, si_unit in (("position", "m"), ("velocity", "m_s"), ("attitude", "rad")):
        residuals = [residual for residual in path.residuals if residual.quantity == quantity]
        if residuals:
            worst = max(residuals, key=lambda residual: residual.size)
            facts[f"residual_{quantity}_worst_{si_unit}"] = worst.size
            facts[f"residual_{quantity}_worst_at_s"] = worst.time
    is_strong = load > STANDARD_GRAVITY
    return facts | _attitude_facts(card, path, flight, t[is_strong], force[is_strong])


def _attitude_facts(
    card: TableTrajectory, path: RowFit, flight: Trajectory, t: Floats, force: Floats
) -> dict[str, float]:
    """Return the interpolation error of the attitude rows, and the median angle of the forces from the roll axis.

    Without rows of attitude there are no facts.

    Parameters
    ----------
    card : TableTrajectory
        Card with the limit of the angle.
    path : RowFit
        Fit of the rows.
    flight : Trajectory
        Trajectory of the file.
    t : (n,) s
        Times at which the force defines the direction of thrust.
    force : (n, 3) m/s^2
        Specific forces at these times, frame i.

    Raises
    ------
    InputError
        The median angle exceeds the limit of the card.
    """
    rows = path.rows
    if rows.q_b_i is None:
        return {}
    coarse = attitude_fit(rows, rows.t[::2], rows.q_b_i[::2])
    omitted_rows = slice(1, None if rows.t.size % 2 else -1, 2)  # rows not used by the coarse spline, within its range
    errors = angles_between(coarse(rows.t[omitted_rows]), rows.q_b_i[omitted_rows])
    facts = {"attitude_from_half_the_rows_worst_rad": float(np.max(errors))}
    if t.size:
        roll_axis = matrices(motion(flight, t).q_b_i)[:, :, 0]
        cosine = np.einsum("ij,ij->i", unit(force), roll_axis)
        angle = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
        facts["force_off_roll_axis_median_rad"] = angle
        if angle > card.largest_force_angle:
            raise InputError(
                f"{card.file}: forces above 1 g lie {np.degrees(angle):.0f} deg off the body's x axis (median): are "
                f"turns, scalar and frame of the attitude right? If so, set largest_force_angle"
            )
    return facts
