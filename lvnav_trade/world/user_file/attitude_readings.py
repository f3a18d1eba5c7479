"""Other readings of the attitude of a user's file: how far off the body's x axis the forces lie in each."""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.errors import InputError
from lvnav_trade.frames import matrices, unit
from lvnav_trade.records import Floats
from lvnav_trade.world.user_file.columns import AttitudeColumns, TableTrajectory
from lvnav_trade.world.user_file.rows import read_attitudes

_FRAMES = ("eci", "j2000", "ecef", "ned")
_CERTAIN, _CLEAR = 0.1, 0.5  # of the angle of the stated reading: an angle below is a refusal, or a warning
_CERTAIN_ANGLE, _CLEAR_ANGLE = np.radians(1.0), np.radians(0.1)  # smaller angles of the stated reading mean nothing


class Reading(NamedTuple):
    """A reading of the columns of attitude, and the median angle (rad) of the forces from the body's x axis in it."""

    part: AttitudeColumns
    angle: float


def readings(attitude: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the readings of columns of attitude, the stated one first: frames, scalar and sense."""
    frames = dict.fromkeys([attitude["frame"], *_FRAMES])
    if attitude["form"] == "euler":
        yield from (attitude | {"frame": frame} for frame in frames)
        return
    scalars = dict.fromkeys([attitude["scalar"], "first", "last"] if attitude["form"] == "quaternion" else [None])
    turns = dict.fromkeys([attitude["turns"], "body_to_frame", "frame_to_body"])
    for scalar, frame, sense in product(scalars, frames, turns):
        yield attitude | {"frame": frame, "turns": sense, "scalar": scalar}


def compared(card: TableTrajectory, r_i: Floats, force: Floats, strong: np.ndarray) -> list[Reading]:
    """Return the readings of a card's attitude, the stated one first; none where the card has no attitude.

    r_i (n, 3) m and force (n, 3) m/s^2, frame i, at the rows; strong (n,): rows whose force says where the x axis lies.
    """
    if card.attitude is None or not np.any(strong):
        return []
    parts = [AttitudeColumns.model_validate(one) for one in readings(card.attitude.model_dump())]
    along = unit(force[strong])
    found = []
    for part, q_b_i in zip(parts, read_attitudes(card, parts, r_i), strict=True):
        if q_b_i is not None:
            cosine = np.einsum("ij,ij->i", along, matrices(q_b_i[strong])[:, :, 0])
            found.append(Reading(part, float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))))
    return found


def better(card: TableTrajectory, found: list[Reading]) -> str:
    """Return what is said of a reading that fits the forces clearly better than the stated one; empty where none does.

    InputError where it fits ten times better, unless the card states largest_force_angle: then the angle is meant.
    """
    if len(found) < 2:
        return ""
    stated, best = found[0], min(found[1:], key=lambda one: one.angle)
    if stated.angle < _CLEAR_ANGLE or best.angle > _CLEAR * stated.angle or stated.angle - best.angle < _CLEAR_ANGLE:
        return ""
    changed = ", ".join(
        f"{name}: {value}" for name, value in best.part.model_dump().items() if value != getattr(stated.part, name)
    )
    text = (
        f"forces above 1 g lie {np.degrees(stated.angle):.2f} deg off the body's x axis (median) as the attitude is "
        f"stated, and {np.degrees(best.angle):.2f} deg with {changed}"
    )
    is_certain = stated.angle > _CERTAIN_ANGLE and best.angle < _CERTAIN * stated.angle
    if is_certain and "largest_force_angle" not in card.model_fields_set:
        raise InputError(f"{card.file}: {text}: state that, or set largest_force_angle if the first is right")
    return text
