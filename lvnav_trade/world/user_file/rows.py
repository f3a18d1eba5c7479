"""The rows of a user's file in frame i: position, velocity, attitude, and how far their digits are rounded."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.errors import InputError
from lvnav_trade.frames import (
    earth_angle,
    ecef_from_eci,
    ecef_from_geodetic,
    eci_from_ecef,
    geodetic_from_ecef,
    gmst,
    matrices,
    quaternions,
    rotation_e_n,
    rotation_i_e,
)
from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.units import parse
from lvnav_trade.world.user_file.columns import AttitudeColumns, PositionColumns, TableTrajectory, VelocityColumns
from lvnav_trade.world.user_file.tabular import read_columns, refuse_bad_times, rounding

Floats = NDArray[np.float64]

_NEAREST, _FARTHEST = 6.3e6, 1e9  # m from the centre of the Earth; what lies outside is a wrong unit
_FASTEST = 2e4  # m/s
_SKEW = 1e-3  # of a quaternion's length from one, or of a matrix from orthonormal


class Rows(NamedTuple):
    """Rows in SI, frame i: t (n,) s from lift-off, r_i (n, 3), v_i (n, 3) or none, q_b_i (n, 4) or none.

    noise: one sigma of a component of a row of position (m), velocity (m/s), attitude (rad); theta0: Earth angle at
    lift-off.
    """

    t: Floats
    r_i: Floats
    v_i: Floats | None
    q_b_i: Floats | None
    noise: tuple[float, float, float]
    theta0: float


def read_rows(card: TableTrajectory) -> Rows:
    """Return the rows of a card's file; InputError names file, row and fault."""
    groups = [(card.time.column,), card.position.columns]
    groups += [part.columns for part in (card.velocity, card.attitude) if part is not None]
    names = list(dict.fromkeys(name for group in groups for name in group))
    table, places = read_columns(card.file, names, card.delimiter)

    def columns(part: tuple[str, ...]) -> Floats:
        return table[:, [names.index(name) for name in part]]

    t = (columns((card.time.column,))[:, 0] - card.time.liftoff) * _factor(card.time.unit, "s")
    refuse_bad_times(t, card.file, places)
    theta0 = gmst(card.epoch)
    turn = 0.0 if card.greenwich is None else theta0 - card.greenwich  # from the axes of frame i to the file's, about z
    r_i, noise_r = _positions(card, card.position, columns(card.position.columns), t, theta0, turn, places)
    v_i, noise_v, q_b_i, noise_q = None, 0.0, None, 0.0
    if card.velocity is not None:
        v_i, noise_v = _velocities(card, card.velocity, columns(card.velocity.columns), (t, r_i, theta0, turn), places)
    if card.attitude is not None:
        q_b_i, noise_q = _attitudes(card, card.attitude, columns(card.attitude.columns), (t, r_i, theta0, turn), places)
    given = (card.position_noise, card.velocity_noise, card.attitude_noise)
    seen = (noise_r, noise_v, noise_q)
    noise = tuple(found if stated is None else stated for stated, found in zip(given, seen, strict=True))
    return Rows(t, r_i, v_i, q_b_i, (noise[0], noise[1], noise[2]), theta0)


def _factor(unit: str, si: str) -> float:
    return parse(f"1 {unit}", si)


def _rounding(table: Floats, factors: list[float]) -> float:
    return max(rounding(column) * factor for column, factor in zip(table.T, factors, strict=True))


def _positions(
    card: TableTrajectory, part: PositionColumns, table: Floats, t: Floats, theta0: float, turn: float,
    places: list[str],
) -> tuple[Floats, float]:  # fmt: skip
    """Return r_i (n, 3) and one sigma of its rounding."""
    if part.frame == "geodetic":
        angle, length = _factor(part.unit, "rad"), _factor(part.height_unit or "m", "m")
        latitude, longitude, height = table[:, 0] * angle, table[:, 1] * angle, table[:, 2] * length
        for name, values, bound in ((0, latitude, 0.5 * math.pi), (1, longitude, 2.0 * math.pi)):
            for k in np.flatnonzero(np.abs(values) > bound + 1e-12)[:1]:
                what = f"{table[k, name]:g} {part.unit} is no {('latitude', 'longitude')[name]}"
                raise InputError(f"{card.file}:{places[k]}: {part.columns[name]}: {what}")
        r_i = eci_from_ecef(ecef_from_geodetic(latitude, longitude, height), earth_angle(theta0, t))
        factors = [angle * SEMI_MAJOR, angle * SEMI_MAJOR * float(np.cos(latitude[0])), length]
    else:
        length = _factor(part.unit, "m")
        factors = [length] * 3
        r_i = eci_from_ecef(table * length, earth_angle(theta0, t) if part.frame == "ecef" else turn)
    distance = np.linalg.norm(r_i, axis=1)
    for k in np.flatnonzero((distance < _NEAREST) | (distance > _FARTHEST))[:1]:
        raise InputError(
            f"{card.file}:{places[k]}: the position is {distance[k] * 1e-3:.6g} km from the Earth's centre; is the "
            f"unit right?"
        )
    return r_i, _rounding(table, factors)


_Context = tuple[Floats, Floats, float, float]  # t, r_i, theta0, turn


def _velocities(
    card: TableTrajectory, part: VelocityColumns, table: Floats, context: _Context, places: list[str]
) -> tuple[Floats, float]:
    """Return v_i (n, 3) and one sigma of its rounding."""
    t, r_i, theta0, turn = context
    factor = _factor(part.unit, "m/s")
    v = table * factor
    for k in np.flatnonzero(np.linalg.norm(v, axis=1) > _FASTEST)[:1]:
        speed = float(np.linalg.norm(v[k]))
        raise InputError(f"{card.file}:{places[k]}: a speed of {speed * 1e-3:.6g} km/s; is the unit right?")
    if part.frame == "eci":
        return eci_from_ecef(v, turn), _rounding(table, [factor] * 3)
    theta = earth_angle(theta0, t)
    r_e = ecef_from_eci(r_i, theta)
    if part.frame == "ned":
        latitude, longitude, _ = geodetic_from_ecef(r_e)
        v = np.einsum("kji,kj->ki", rotation_e_n(latitude, longitude), v)
    return eci_from_ecef(v + np.cross([0.0, 0.0, OMEGA], r_e), theta), _rounding(table, [factor] * 3)


def _attitudes(
    card: TableTrajectory, part: AttitudeColumns, table: Floats, context: _Context, places: list[str]
) -> tuple[Floats, float]:
    """Return q_b_i (n, 4), of continuous sign, and one sigma of its rounding in rad."""
    t, r_i, theta0, turn = context
    C, noise = _matrices(card, part, table, places)
    theta = earth_angle(theta0, t)
    if part.frame == "eci":
        C_i = np.broadcast_to(rotation_i_e(turn), C.shape)
    else:
        C_i = rotation_i_e(theta)
        if part.frame == "ned":
            latitude, longitude, _ = geodetic_from_ecef(ecef_from_eci(r_i, theta))
            C_i = rotation_e_n(latitude, longitude) @ C_i
    return quaternions(np.asarray(np.einsum("kji,kjl->kil", C_i, C))), noise


def _matrices(card: TableTrajectory, part: AttitudeColumns, table: Floats, places: list[str]) -> tuple[Floats, float]:
    """Return the matrices (n, 3, 3) from body components to those of the attitude's frame, and the rounding in rad."""
    if part.form == "euler":
        factor = _factor(part.unit or "rad", "rad")
        return _from_euler(table * factor), _rounding(table, [factor] * 3)
    if part.form == "quaternion":
        q = table if part.scalar == "first" else table[:, [3, 0, 1, 2]]
        length = np.linalg.norm(q, axis=1)
        for k in np.flatnonzero(np.abs(length - 1.0) > _SKEW)[:1]:
            raise InputError(f"{card.file}:{places[k]}: the quaternion has length {length[k]:.6g}, not 1")
        C, noise = matrices(q / length[:, None]), 2.0 * _rounding(table, [1.0] * 4)
    else:
        C, noise = table.reshape(-1, 3, 3), _rounding(table, [1.0] * 9)
        skew = np.max(np.abs(C @ np.swapaxes(C, 1, 2) - np.eye(3)), axis=(1, 2))
        for k in np.flatnonzero((skew > _SKEW) | (np.linalg.det(C) < 0.0))[:1]:
            raise InputError(f"{card.file}:{places[k]}: the matrix is no rotation (off by {skew[k]:.3g})")
    return np.asarray(C if part.turns == "body_to_frame" else np.swapaxes(C, 1, 2)), noise


def _from_euler(angles: Floats) -> Floats:
    """Return the matrices (n, 3, 3), body to frame, of yaw, pitch, roll (n, 3) in rad."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
