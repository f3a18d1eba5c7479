"""Clock offset and inertial axes of a user's file, from its first rows at rest before lift-off."""

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity
from lvnav_trade.quantities.limits import STREAM
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.j2000 import rotation_to_date
from lvnav_trade.trajectory.files.rows import Rows, si

REST = 1.0  # m/s relative to the Earth; a slower vehicle is at rest
_WALK = 10.0  # m/s; precession between two dates moves a point at rest by less (1.1 m/s in 2024)
_LIFTOFF, _LATEST_LIFTOFF = 3.0, 60.0  # s; offset of lift-off from time zero without a remark, and without an error


def rest_end(rows: Rows) -> float | None:
    """Return the time (s) of the last row at rest before motion; None if the first row moves or no row moves."""
    v = np.gradient(rows.r_i, rows.t, axis=0) if rows.v_i is None else rows.v_i
    moving = np.linalg.norm(earth_velocity(rows.r_i, v), axis=1) > REST
    return None if moving[0] or not moving.any() else float(rows.t[int(np.argmax(moving)) - 1])


def clock_remark(card: TableTrajectory, rows: Rows) -> str:
    """Return the warning about a file that begins at rest and lifts off at a time other than zero; empty for none.

    InputError if the offset exceeds a minute, or the first row is a day from lift-off: the clock of the file then has
    another origin.
    """
    t, last_rest = rows.t, rest_end(rows)
    begin = float(t[0]) if last_rest is None else last_rest
    shown = begin / si(card.time.unit, "s") + card.time.liftoff
    text = f"state what the column shows at lift-off, as YAML: time: {{..., liftoff: {shown:.12g}}}"
    if last_rest is None:
        if abs(begin) > STREAM:
            raise InputError(f"{card.file}: the first row is {begin / 3600.0:.1f} h from lift-off: {text}")
        return ""
    if abs(last_rest) <= _LIFTOFF + float(np.max(np.diff(t[:3]))):
        return ""
    rests = f"the vehicle rests on the ground until {last_rest:.9g} s, and lift-off is at 0 s: {text}"
    if abs(last_rest) > _LATEST_LIFTOFF:
        raise InputError(f"{card.file}: {rests}; events count from lift-off, and the epoch is its time")
    return rests


def axes_remark(card: TableTrajectory, rows: Rows) -> str:
    """Return the warning that the first row moves in the card's inertial axes but rests in those of another date."""
    frame = card.position.frame
    if frame not in ("eci", "j2000") or rows.v_i is None or card.velocity is None or card.velocity.frame != frame:
        return ""
    if card.greenwich is not None:
        return ""
    turn = rotation_to_date(card.epoch)
    r, v = rows.r_i[0], rows.v_i[0]
    speed = float(np.linalg.norm(earth_velocity(r, v)))
    turn = turn if frame == "eci" else turn.T
    other = float(np.linalg.norm(earth_velocity(turn @ r, turn @ v)))
    if speed > _WALK or other > 0.1 * speed:
        return ""
    instead = {"eci": "j2000", "j2000": "eci"}[frame]
    return (
        f"the first row moves at {speed:.3g} m/s over the Earth in frame {frame}, and at {other:.3g} m/s in frame "
        f"{instead}: are the axes those?"
    )
