"""Other interpretations of the attitude of a user's file, and the angle of the forces from the body x axis in each."""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import matrices, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.files.columns import AttitudeColumns, TableTrajectory
from lvnav_trade.trajectory.files.rows import read_attitudes

_FRAMES = ("eci", "j2000", "ecef", "ned")
# Ratio to the angle of the card's interpretation below which another interpretation is refused, or a warning
_CERTAIN, _CLEAR = 0.1, 0.5
_CERTAIN_ANGLE, _CLEAR_ANGLE = np.radians(1.0), np.radians(0.1)  # smaller angles are not significant


class Reading(NamedTuple):
    """An interpretation of the attitude columns.

    part : Settings of the interpretation.
    angle : rad. Median angle of the specific forces from the body x axis.
    """

    part: AttitudeColumns
    angle: float


def readings(attitude: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the interpretations of attitude columns by frame, scalar and sense, that of the card first."""
    frames = dict.fromkeys([attitude["frame"], *_FRAMES])
    if attitude["form"] == "euler":
        yield from (attitude | {"frame": frame} for frame in frames)
        return
    scalars = dict.fromkeys([attitude["scalar"], "first", "last"] if attitude["form"] == "quaternion" else [None])
    turns = dict.fromkeys([attitude["turns"], "body_to_frame", "frame_to_body"])
    for scalar, frame, sense in product(scalars, frames, turns):
        yield attitude | {"frame": frame, "turns": sense, "scalar": scalar}


def compared(card: TableTrajectory, r_i: Floats, force: Floats, strong: np.ndarray) -> list[Reading]:
    """Return the interpretations of a card's attitude, that of the card first; an empty list without attitude.

    r_i : (n, 3) m, frame i. Positions of the rows.
    force : (n, 3) m/s^2, frame i. Specific forces at the rows.
    strong : (n,). Rows with a force large enough to define the direction of thrust.
    """
    if card.attitude is None or not np.any(strong):
        return []
    parts = [AttitudeColumns.model_validate(settings) for settings in readings(card.attitude.model_dump())]
    along = unit(force[strong])
    candidates = []
    for part, q_b_i in zip(parts, read_attitudes(card, parts, r_i), strict=True):
        if q_b_i is not None:
            cosine = np.einsum("ij,ij->i", along, matrices(q_b_i[strong])[:, :, 0])
            candidates.append(Reading(part, float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))))
    return candidates


def better(card: TableTrajectory, candidates: list[Reading]) -> str:
    """Return the warning about an interpretation that fits the forces clearly better than that of the card.

    The text is empty if there is none. InputError if the fit is ten times better, unless the card sets
    largest_force_angle, which confirms the angle.
    """
    if len(candidates) < 2:
        return ""
    stated, best = candidates[0], min(candidates[1:], key=lambda reading: reading.angle)
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
