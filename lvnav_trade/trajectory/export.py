"""Export of a true trajectory as a trajectory file of the user's format, with its card."""

import math
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_i_n
from lvnav_trade.quantities.input_limits import DATA_ROWS
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.plausibility import FileFlightCard, peaks
from lvnav_trade.trajectory.files.columns import OWN_EVENTS, TableTrajectory
from lvnav_trade.trajectory.flight import TrajectoryCard, build
from lvnav_trade.trajectory.truth import Trajectory, motion

COLUMNS = (
    "time_s",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "north_m_s",
    "east_m_s",
    "down_m_s",
    "q0",
    "q1",
    "q2",
    "q3",
)
_SAME = 1e-6  # s; times closer than this count as equal
_SPARE = 1.02  # limit of an exported peak over the peak of the trajectory
_STEP = 0.0317  # s between the times at which two trajectories are compared; no multiple of a usual step


class ExportedFlight(NamedTuple):
    """An exported trajectory.

    text : Text of the CSV file.
    card : Fields of its card.
    flight : The trajectory, without oscillations.
    """

    text: str
    card: dict[str, Any]
    flight: Trajectory


def export_trajectory(card: TrajectoryCard, file: str, name: str, rate: float) -> ExportedFlight:
    """Return the trajectory of a card as CSV rows and a card.

    Rows have geodetic position, velocity relative to the Earth (ned) and the quaternion from body to frame i, with all
    digits. There is a row at every jump of force. Oscillations are not in the rows but remain settings of the card.

    Parameters
    ----------
    card : TrajectoryCard
    file : str
        Name of the CSV file in the exported card.
    name : str
        Name of the exported card.
    rate : float
        Rate of the rows (Hz).

    Raises
    ------
    InputError
        The trajectory cannot be computed, or has more rows than can be read.
    """
    flight = build(card.model_copy(update={"oscillation": (), "named_times": {}}))
    hold = flight.phases[0].end - flight.start if flight.phases[0].name == "pad" else 0.0
    events = _events(flight, hold)
    t = _times(flight.start + hold, flight.end, list(events.values()), rate)
    source = f"Rows of the card {card.name}, {rate:g} Hz, written by lvnav-trade export-trajectory; {card.source}"
    fields = _layout() | {
        "name": name,
        "source": " ".join(source.split()),
        "epoch": card.epoch,
        "file": file,
        "events": {event: f"{time!r} s" for event, time in events.items() if event not in OWN_EVENTS},
        "largest_force_angle": "180 deg",  # no check: the attitude is correct whatever the direction of the force
        **_limits(card, flight),
        **_copied_fields(card),
    }
    if hold > 0.0:
        fields["pad_hold"] = f"{hold!r} s"
    return ExportedFlight(
        text=_text(card, flight, t),
        card=fields,
        flight=flight,
    )


def _layout() -> dict[str, Any]:
    """Return the fields of a card that describe the columns."""
    return {
        "kind": "table",
        "time": {"column": COLUMNS[0], "unit": "s"},
        "position": {"frame": "geodetic", "columns": [*COLUMNS[1:4]], "unit": "deg", "height_unit": "m"},
        "velocity": {"frame": "ned", "columns": [*COLUMNS[4:7]], "unit": "m/s"},
        "attitude": {
            "form": "quaternion",
            "frame": "eci",
            "columns": [*COLUMNS[7:]],
            "scalar": "first",
            "turns": "body_to_frame",
        },
    }


def _events(flight: Trajectory, hold: float) -> dict[str, float]:
    """Return the times (s) of the events in order, with names for jumps of force without an event."""
    events = dict(flight.events)

    for phase in flight.phases[1:]:
        time = phase.start
        if time <= flight.start + hold + _SAME:
            continue
        is_named = any(abs(time - event_time) <= _SAME for event_time in events.values())
        if not is_named:
            number = 1 + sum(name.startswith("change_") for name in events)
            events[f"change_{number}"] = time
    return dict(sorted(events.items(), key=lambda event: event[1]))


def _times(begin: float, end: float, events: list[float], rate: float) -> Floats:
    """Return the times of the rows: a grid from `begin`, with the events in place of grid points close to them.

    Parameters
    ----------
    begin, end : float
        First and last time (s since lift-off).
    events : list of float
        Times of the events (s).
    rate : float
        Rate of the grid (Hz).

    Returns
    -------
    (n,) s
        Increasing times.

    Raises
    ------
    InputError
        The rate is not positive, or there are more rows than can be read.
    """
    if not rate > 0.0:
        raise InputError("the rate of the rows should be above zero")
    n_row = (end - begin) * rate
    if n_row > DATA_ROWS:
        raise InputError(f"{n_row:.0f} rows; at most {DATA_ROWS} are read: give a lower rate")
    inner_events = [time for time in events if begin < time < end]
    fixed_times = np.unique([begin, *inner_events, end])
    fixed_times = fixed_times[np.diff(fixed_times, prepend=-math.inf) > _SAME]
    first = math.ceil(begin * rate)
    last = math.floor(end * rate)
    grid = np.arange(first, last + 1) / rate
    insertion = np.searchsorted(fixed_times, grid)
    next_index = np.clip(insertion, 1, fixed_times.size - 1)
    to_next = np.abs(grid - fixed_times[next_index])
    to_previous = np.abs(grid - fixed_times[next_index - 1])
    distance = np.minimum(to_next, to_previous)
    free_points = grid[distance > 0.99 / rate]
    return np.sort(np.concatenate([fixed_times, free_points]))


def _text(card: TrajectoryCard, flight: Trajectory, t: Floats) -> str:
    """Return the text of the CSV file, with all digits of the numbers.

    Parameters
    ----------
    card : TrajectoryCard
        Card whose name is written in the first line.
    flight : Trajectory
        The trajectory.
    t : (n,) s
        Times of the rows, since lift-off.
    """
    true = motion(flight, t)
    theta = earth_angle(flight.theta0, t)
    r_e = ecef_from_eci(true.r_i, theta)
    latitude, longitude, height = geodetic_from_ecef(r_e)
    velocity = earth_velocity(true.r_i, true.v_i)
    C_i_n = rotation_i_n(true.r_i, theta)
    v_n = np.einsum("kij,kj->ki", C_i_n, velocity)
    columns = [
        t,
        np.degrees(latitude),
        np.degrees(longitude),
        height,
        v_n,
        true.q_b_i,
    ]
    table = np.column_stack(columns)
    name = " ".join(card.name.split())
    lines = [f"# Flight of the card {name}, written by lvnav-trade export-trajectory", ",".join(COLUMNS)]
    for row in table.tolist():
        lines.append(",".join(repr(value) for value in row))
    return "\n".join(lines) + "\n"


def _limits(card: TrajectoryCard, flight: Trajectory) -> dict[str, str]:
    """Return the plausibility limits that the trajectory needs above the defaults, as text by field of the card."""
    units = {"highest_load": "m/s^2", "highest_rate": "rad/s", "highest_spin": "rad/s"}
    limits = {}
    for peak in peaks(flight):
        default = float(TableTrajectory.model_fields[peak.field].default)
        card_limit = getattr(card, peak.field) if isinstance(card, FileFlightCard) else default
        limit = max(peak.size * _SPARE, card_limit)
        if limit > default:
            limits[peak.field] = f"{limit!r} {units[peak.field]}"
    return limits


def _copied_fields(card: TrajectoryCard) -> dict[str, Any]:
    """Return the fields that the export copies from the card."""
    data = card.model_dump(mode="json", exclude_defaults=True)
    fields = {}
    for field in ("oscillation", "named_times"):
        if data.get(field):
            fields[field] = data[field]
    return fields


def difference(flight: Trajectory, second: Trajectory) -> dict[str, float]:
    """Return the largest differences of two trajectories in their common time.

    Times within 1 us of a jump are excluded.

    Parameters
    ----------
    flight, second : Trajectory
        The two trajectories.

    Returns
    -------
    dict
        Largest difference (SI) by quantity and unit: position and velocity in frame i, attitude as the angle of the
        relative rotation, specific force and body rate in body axes.
    """
    begin = max(flight.start, second.start)
    end = min(flight.end, second.end)
    t = np.arange(begin, end, _STEP)[1:]
    jumps = np.array([phase.start for phase in (*flight.phases, *second.phases)])
    time_from_jumps = np.abs(t[:, None] - jumps)
    distance = np.min(time_from_jumps, axis=1)
    t = t[distance > _SAME]
    a = motion(flight, t)
    b = motion(second, t)

    def largest(p: Floats, q: Floats) -> float:
        length = np.linalg.norm(p - q, axis=1)
        return float(np.max(length))

    # Unit quaternions that differ by an angle are 2 sin(angle / 4) apart; q and -q are the same attitude.
    same_sign = np.linalg.norm(a.q_b_i - b.q_b_i, axis=1)
    other_sign = np.linalg.norm(a.q_b_i + b.q_b_i, axis=1)
    half_distance = 0.5 * np.minimum(same_sign, other_sign)
    angle = 4.0 * np.arcsin(np.minimum(1.0, half_distance))
    return {
        "position_m": largest(a.r_i, b.r_i),
        "velocity_m_s": largest(a.v_i, b.v_i),
        "attitude_rad": float(np.max(angle)),
        "specific_force_m_s2": largest(a.f_b, b.f_b),
        "body_rate_rad_s": largest(a.w_ib_b, b.w_ib_b),
    }
