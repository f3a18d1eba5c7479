"""First look at a user's file: clock offset and axes from its rows at rest, other readings of its attitude."""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity, matrices, unit
from lvnav_trade.quantities.input_limits import STREAM
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.files.columns import AttitudeColumns, TableTrajectory
from lvnav_trade.trajectory.files.j2000 import rotation_to_date
from lvnav_trade.trajectory.files.rows import TrajectoryRows, read_attitudes, si_factor

REST = 1.0  # m/s relative to the Earth; a slower vehicle is at rest
_WALK = 10.0  # m/s; precession between two dates moves a point at rest by less (1.1 m/s in 2024)
_LIFTOFF, _LATEST_LIFTOFF = 3.0, 60.0  # s; offset of lift-off from time zero without a remark, and without an error


def rest_end(rows: TrajectoryRows) -> float | None:
    """Return the time (s) of the last row at rest before motion; None if the first row moves or no row moves."""
    v = np.gradient(rows.r_i, rows.t, axis=0) if rows.v_i is None else rows.v_i
    ground_velocity = earth_velocity(rows.r_i, v)
    speed = np.linalg.norm(ground_velocity, axis=1)
    is_moving = speed > REST
    if is_moving[0] or not is_moving.any():
        return None
    first_moving = int(np.argmax(is_moving))
    return float(rows.t[first_moving - 1])


def clock_remark(card: TableTrajectory, rows: TrajectoryRows) -> str:
    """Return the warning about a file that begins at rest and lifts off at a time other than zero; empty for none.

    InputError if the offset exceeds a minute, or the first row is a day from lift-off: the clock of the file then has
    another origin.
    """
    last_rest = rest_end(rows)
    begin = float(rows.t[0]) if last_rest is None else last_rest
    column_value = begin / si_factor(card.time.unit, "s") + card.time.liftoff
    advice = f"state what the column shows at lift-off, as YAML: time: {{..., liftoff: {column_value:.12g}}}"
    if last_rest is None:
        if abs(begin) > STREAM:
            raise InputError(f"{card.file}: the first row is {begin / 3600.0:.1f} h from lift-off: {advice}")
        return ""
    longest_interval = float(np.max(np.diff(rows.t[:3])))
    if abs(last_rest) <= _LIFTOFF + longest_interval:
        return ""
    remark = f"the vehicle rests on the ground until {last_rest:.9g} s, and lift-off is at 0 s: {advice}"
    if abs(last_rest) > _LATEST_LIFTOFF:
        raise InputError(f"{card.file}: {remark}; events count from lift-off, and the epoch is its time")
    return remark


def axes_remark(card: TableTrajectory, rows: TrajectoryRows) -> str:
    """Return the warning that the first row moves in the card's inertial axes but rests in those of another date."""
    frame = card.position.frame
    if frame not in ("eci", "j2000") or card.greenwich is not None:
        return ""
    if rows.v_i is None or card.velocity is None or card.velocity.frame != frame:
        return ""
    turn = rotation_to_date(card.epoch)
    if frame != "eci":
        turn = turn.T
    r, v = rows.r_i[0], rows.v_i[0]
    speed = float(np.linalg.norm(earth_velocity(r, v)))
    turned_speed = float(np.linalg.norm(earth_velocity(turn @ r, turn @ v)))
    if speed > _WALK or turned_speed > 0.1 * speed:
        return ""
    other_frame = {"eci": "j2000", "j2000": "eci"}[frame]
    return (
        f"the first row moves at {speed:.3g} m/s over the Earth in frame {frame}, and at {turned_speed:.3g} m/s in "
        f"frame {other_frame}: are the axes those?"
    )


_FRAMES = ("eci", "j2000", "ecef", "ned")
# Ratio to the angle of the card's interpretation below which another interpretation is refused, or a warning
_CERTAIN, _CLEAR = 0.1, 0.5
_CERTAIN_ANGLE, _CLEAR_ANGLE = np.radians(1.0), np.radians(0.1)  # smaller angles are not significant


class AttitudeInterpretation(NamedTuple):
    """An interpretation of the attitude columns.

    columns : Attitude columns with the settings of the interpretation.
    angle : rad. Median angle of the specific forces from the body x axis.
    """

    columns: AttitudeColumns
    angle: float


def interpretations(attitude: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the interpretations of attitude columns by frame, scalar and sense, that of the card first."""
    # keys of dictionaries, so that the setting of the card comes first and only once
    frames = dict.fromkeys([attitude["frame"], *_FRAMES])
    if attitude["form"] == "euler":
        for frame in frames:
            yield attitude | {"frame": frame}
        return
    scalars: list[Any] = [None]
    if attitude["form"] == "quaternion":
        scalars = list(dict.fromkeys([attitude["scalar"], "first", "last"]))
    senses = dict.fromkeys([attitude["turns"], "body_to_frame", "frame_to_body"])
    for scalar, frame, sense in product(scalars, frames, senses):
        yield attitude | {"frame": frame, "turns": sense, "scalar": scalar}


def compare_interpretations(
    card: TableTrajectory, r_i: Floats, force: Floats, is_strong: np.ndarray
) -> list[AttitudeInterpretation]:
    """Return the interpretations of a card's attitude, that of the card first; an empty list without attitude.

    Parameters
    ----------
    card : TableTrajectory
        Card with the columns of attitude.
    r_i : (n, 3) m
        Positions of the rows, frame i.
    force : (n, 3) m/s^2
        Specific forces at the rows, frame i.
    is_strong : (n,) bool
        Rows with a force large enough to define the direction of thrust.
    """
    if card.attitude is None or not np.any(is_strong):
        return []
    settings = [AttitudeColumns.model_validate(fields) for fields in interpretations(card.attitude.model_dump())]
    thrust_direction = unit(force[is_strong])
    candidates = []
    for columns, q_b_i in zip(settings, read_attitudes(card, settings, r_i), strict=True):
        if q_b_i is None:
            continue
        roll_axis = matrices(q_b_i[is_strong])[:, :, 0]
        cosine = np.einsum("ij,ij->i", thrust_direction, roll_axis)
        angles = np.arccos(np.clip(cosine, -1.0, 1.0))
        median_angle = float(np.median(angles))
        candidates.append(AttitudeInterpretation(columns, median_angle))
    return candidates


def interpretation_warning(card: TableTrajectory, candidates: list[AttitudeInterpretation]) -> str:
    """Return the warning about an interpretation that fits the forces clearly better than that of the card.

    The text is empty if there is none. InputError if the fit is ten times better, unless the card sets
    largest_force_angle, which confirms the angle.
    """
    if len(candidates) < 2:
        return ""
    card_interpretation = candidates[0]
    best = min(candidates[1:], key=lambda candidate: candidate.angle)
    card_angle = card_interpretation.angle
    is_good = card_angle < _CLEAR_ANGLE
    is_similar = best.angle > _CLEAR * card_angle or card_angle - best.angle < _CLEAR_ANGLE
    if is_good or is_similar:
        return ""
    changes = []
    for name, value in best.columns.model_dump().items():
        if value != getattr(card_interpretation.columns, name):
            changes.append(f"{name}: {value}")
    text = (
        f"forces above 1 g lie {np.degrees(card_angle):.2f} deg off the body's x axis (median) as "
        f"the attitude is stated, and {np.degrees(best.angle):.2f} deg with {', '.join(changes)}"
    )
    is_certain = card_angle > _CERTAIN_ANGLE and best.angle < _CERTAIN * card_angle
    if is_certain and "largest_force_angle" not in card.model_fields_set:
        raise InputError(f"{card.file}: {text}: state that, or set largest_force_angle if the first is right")
    return text
