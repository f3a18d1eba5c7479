"""Rows of a user's file: position, velocity and attitude in frame i."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.data_file import FEWEST, read_columns, refuse_first
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import restore_time_stamps
from lvnav_trade.quantities.units import parse
from lvnav_trade.trajectory.files.columns import AttitudeColumns, PositionColumns, TableTrajectory, VelocityColumns
from lvnav_trade.trajectory.files.j2000 import rotation_to_date
from lvnav_trade.trajectory.files.row_checks import find_pair_starts, refuse_repeated, rounding, usable_rows

_LARGEST_TURN = 1.0  # rad in a gap; the direction of a rotation near half a turn is ambiguous


def row_pair_times(card: TableTrajectory) -> list[float]:
    """Return the times (s) with two different rows, before and after an event that the card may declare."""
    names = [card.time.column, *card.position.columns]
    if card.velocity is not None:
        names += card.velocity.columns
    table, _ = read_columns(card.file, names, card.delimiter)
    table = table[~_is_repeated(table)]
    column = table[:, 0]
    repeated_rows = np.flatnonzero(np.diff(column) == 0.0)
    since_liftoff = column[repeated_rows] - card.time.liftoff
    times = since_liftoff * si_factor(card.time.unit, "s")
    return list(dict.fromkeys(times.tolist()))


def _is_repeated(table: Floats) -> NDArray[np.bool_]:
    """Return which rows are equal to the row before, as in files whose phases end and begin with the same state."""
    is_equal = np.all(table[1:] == table[:-1], axis=1)
    return np.append(False, is_equal)


_NEAREST, _FARTHEST = 6.3e6, 1e9  # m from the centre of the Earth; positions outside have a wrong unit
_FASTEST = 2e4  # m/s
_JUMP = 1e-3  # m/s, rad; allowed difference of the two rows of an event, in addition to their noise
_SKEW = 1e-3  # allowed deviation of a quaternion's length from 1, or of a matrix from orthonormal


class TrajectoryRows(NamedTuple):
    """Rows of a trajectory file in SI, frame i.

    t : (n,) s since lift-off.
    r_i : (n, 3) m. Position.
    v_i : (n, 3) m/s. Inertial velocity; None without columns of it.
    q_b_i : (n, 4). Unit quaternion from body to frame i; None without columns of it.
    noise : One sigma of a component of position (m), velocity (m/s) and attitude (rad).
    theta0 : rad. Earth angle at lift-off.
    notes : Remarks on gaps and omitted rows.
    """

    t: Floats
    r_i: Floats
    v_i: Floats | None
    q_b_i: Floats | None
    noise: tuple[float, ...]
    theta0: float
    notes: tuple[str, ...] = ()


def read_rows(card: TableTrajectory) -> TrajectoryRows:
    """Return the rows of a card's file.

    Raises
    ------
    InputError
        The file cannot be read, or a row is impossible. The message names file, row and error.
    """
    reader = _ColumnReader(card)
    r_i, noise_r = reader.positions(card.position)
    v_i, noise_v = None, 0.0
    if card.velocity is not None:
        v_i, noise_v = reader.velocities(card.velocity, r_i)
    q_b_i, noise_q = None, 0.0
    if card.attitude is not None:
        q_b_i, noise_q = reader.attitudes(card.attitude, r_i)
    noise_r = reader.add_timing_noise(r_i, noise_r)
    noise_v = reader.add_timing_noise(v_i, noise_v)
    noise = (
        noise_r if card.position_noise is None else card.position_noise,
        noise_v if card.velocity_noise is None else card.velocity_noise,
        noise_q if card.attitude_noise is None else card.attitude_noise,
    )
    reader.refuse_jumps(card.events, (r_i, v_i, q_b_i), noise)
    is_single = ~reader.is_pair_start
    rows = TrajectoryRows(
        t=reader.t[is_single],
        r_i=r_i[is_single],
        v_i=None if v_i is None else v_i[is_single],
        q_b_i=None if q_b_i is None else q_b_i[is_single],
        noise=noise,
        theta0=reader.theta0,
        notes=tuple(reader.notes),
    )
    if rows.q_b_i is not None:
        reader.refuse_lost_turns(rows.t, rows.q_b_i)
    return rows


def read_attitudes(
    card: TableTrajectory, interpretations: Sequence[AttitudeColumns], r_i: Floats
) -> list[Floats | None]:
    """Return q_b_i (n, 4) of the rows for each interpretation of the attitude columns.

    The result is None for an interpretation in which the columns are no attitude.

    r_i : (n, 3) m. Positions of the rows.
    """
    reader = _ColumnReader(card)
    is_single = ~reader.is_pair_start
    positions = r_i[np.cumsum(is_single) - 1 + reader.is_pair_start]  # both rows of an event have that of the second
    attitudes: list[Floats | None] = []
    for columns in interpretations:
        try:
            q_b_i, _ = reader.attitudes(columns, positions)
            attitudes.append(q_b_i[is_single])
        except InputError:
            attitudes.append(None)
    return attitudes


def si_factor(unit: str, base: str) -> float:
    """Return the size of a unit in the SI unit `base`."""
    return parse(f"1 {unit}", base)


def _largest_rounding(table: Floats, *factors: float) -> float:
    """Return the largest rounding of the columns of a table, times a factor for each."""
    roundings = [rounding(column) * factor for column, factor in zip(table.T, factors, strict=True)]
    return max(roundings)


class _ColumnReader:
    """Columns of a card's file by name, with times t (n,) s and Earth angles theta (n,).

    is_pair_start : (n,). Whether a row is the first of two rows at a declared event; it ends the phase before the event
        and is not used otherwise.
    time_noise : s. One sigma of the rounding of the times.
    turn : rad. Angle about z from frame i to the inertial axes of the file.
    gaps : Gaps between the rows.
    notes : Remarks on gaps and omitted rows.
    """

    t: Floats
    is_pair_start: NDArray[np.bool_]
    notes: list[str]

    def __init__(self, card: TableTrajectory) -> None:
        names = _column_names(card)
        table, places = read_columns(card.file, names, card.delimiter)
        is_equal = _is_repeated(table)
        table = table[~is_equal]
        self.file = card.file
        self.places = [place for place, drop in zip(places, is_equal, strict=True) if not drop]
        time_column = table[:, names.index(card.time.column)]
        last = self._read_times(card, time_column)
        if np.any(is_equal):
            number = int(np.sum(is_equal))
            rows = f"{number} row{'s' if number > 1 else ''}"
            self.notes = [*self.notes, f"{rows} equal to the row before left out"]
        self.column = dict(zip(names, table[:last].T, strict=True))
        self.epoch = card.epoch
        self.theta0 = frames.gmst(card.epoch)
        self.theta = frames.earth_angle(self.theta0, self.t)
        self.turn = 0.0 if card.greenwich is None else self.theta0 - card.greenwich

    def _read_times(self, card: TableTrajectory, column: Floats) -> int:
        """Set the times and all that follows from them; return the number of rows up to the end of the flight."""
        second = si_factor(card.time.unit, "s")
        stamps = restore_time_stamps(column, card.time.unit)
        t = (stamps.column - card.time.liftoff) * second
        self.time_noise = stamps.sigma * second
        is_pair_start = find_pair_starts(t, card.events)
        refuse_repeated(t, is_pair_start, card, self.places, stamps.spacing)
        single_rows = np.flatnonzero(~is_pair_start)
        single_places = [self.places[k] for k in single_rows.tolist()]
        count, self.gaps, self.notes = usable_rows(t[single_rows], card.events, card.file, single_places)
        if count < FEWEST:
            end_text = f"before {self.notes[-1]}" if self.notes else "of different times"
            raise InputError(f"{card.file}: {count} rows {end_text}; a trajectory needs {FEWEST} or more")
        if stamps.note:
            self.notes += [stamps.note]
        last = int(single_rows[count - 1]) + 1
        self.t = t[:last]
        self.is_pair_start = is_pair_start[:last]
        return last

    def inertial(self, v: Floats, frame: str) -> Floats:
        """Return vectors (n, 3) of frame eci or j2000 in frame i."""
        if frame == "j2000":
            return np.asarray(v @ rotation_to_date(self.epoch).T)
        return frames.eci_from_ecef(v, self.turn)

    def table(self, names: tuple[str, ...]) -> Floats:
        return np.column_stack([self.column[name] for name in names])

    def refuse(self, is_wrong: NDArray[np.bool_], fault: Callable[[int], str]) -> None:
        """Raise InputError for the first row that is wrong (n,)."""
        refuse_first(is_wrong, self.file, self.places, fault)

    def add_timing_noise(self, values: Floats | None, noise: float) -> float:
        """Return one sigma of rows (n, 3) with the effect of rounded times: their median rate times that rounding."""
        if self.time_noise == 0.0:
            return noise
        rate = 0.0
        if values is not None:
            is_single = ~self.is_pair_start
            change = np.linalg.norm(np.diff(values[is_single], axis=0), axis=1)
            rate = float(np.median(change / np.diff(self.t[is_single])))
        return math.hypot(noise, rate * self.time_noise)

    def refuse_jumps(
        self, events: Mapping[str, float], motion: tuple[Floats, Floats | None, Floats | None], noise: tuple[float, ...]
    ) -> None:
        """Raise InputError if velocity or attitude differ between the two rows of an event.

        Only the force and the reference point of the position can jump.

        motion : r_i (n, 3) m, v_i (n, 3) m/s and q_b_i (n, 4) of all rows.
        noise : As in `TrajectoryRows`.
        """
        r_i, v_i, q_b_i = motion
        for k in np.flatnonzero(self.is_pair_start).tolist():
            # difference of the Earth's velocity between two reference points
            distance = float(np.linalg.norm(r_i[k + 1] - r_i[k]))
            rotation_speed = OMEGA * distance
            if v_i is not None:
                size = float(np.linalg.norm(v_i[k + 1] - v_i[k]))
                limit = _JUMP + 10.0 * noise[1] + rotation_speed
                if size > limit:
                    self._refuse_jump(events, k, f"velocity jumps by {size:.3g} m/s")
            if q_b_i is not None:
                cosine = min(1.0, abs(float(q_b_i[k + 1] @ q_b_i[k])))
                size = 2.0 * math.acos(cosine)
                limit = _JUMP + 10.0 * noise[2] + rotation_speed
                if size > limit:
                    self._refuse_jump(events, k, f"attitude jumps by {size:.3g} rad")

    def _refuse_jump(self, events: Mapping[str, float], k: int, jump: str) -> NoReturn:
        """Raise InputError for a jump between row k and the next, which is at an event."""
        name = min(events, key=lambda event: abs(events[event] - self.t[k]))
        raise InputError(
            f"{self.file}:{self.places[k + 1]}: the {jump} at event {name!r}, "
            f"between the two rows at {self.t[k]:.9g} s: only the force can jump; spread the change over "
            "the time that it takes, or remove one of the two rows"
        )

    def refuse_lost_turns(self, t: Floats, q_b_i: Floats) -> None:
        """Raise InputError for a gap in which the body may turn so far that the direction is ambiguous.

        The rate in the gap is assumed to be the larger of those before and after it; t (n,) s, q_b_i (n, 4).
        """
        q, next_q = q_b_i[:-1], q_b_i[1:]
        cosine = np.abs(np.sum(next_q * q, axis=1))
        angle = 2.0 * np.arccos(np.minimum(1.0, cosine))
        rate = angle / np.diff(t)
        for gap in self.gaps:
            neighbours = [rate[k] for k in (gap.row - 1, gap.row + 1) if 0 <= k < rate.size]
            turn = gap.length * max(neighbours)
            if turn > _LARGEST_TURN:
                raise InputError(
                    f"{self.file}:{self.places[gap.row + 1]}: no data between {gap.start:g} s and {gap.end:g} s, "
                    f"in which the body turns by about {math.degrees(turn):.0f} deg: give the attitude in between"
                )

    def positions(self, columns: PositionColumns) -> tuple[Floats, float]:
        """Return r_i (n, 3) and one sigma of its rounding."""
        table = self.table(columns.columns)
        if columns.frame == "geodetic":
            r_i, noise = self._geodetic_positions(columns, table)
        else:
            metre = si_factor(columns.unit, "m")
            r = table * metre
            r_i = frames.eci_from_ecef(r, self.theta) if columns.frame == "ecef" else self.inertial(r, columns.frame)
            noise = _largest_rounding(table, metre, metre, metre)
        distance = np.linalg.norm(r_i, axis=1)
        self.refuse(
            (distance < _NEAREST) | (distance > _FARTHEST),
            lambda k: f"the position is {distance[k] * 1e-3:.6g} km from the Earth's centre; is the unit right?",
        )
        return r_i, noise

    def _geodetic_positions(self, columns: PositionColumns, table: Floats) -> tuple[Floats, float]:
        """Return r_i (n, 3) of latitude, longitude and height, and one sigma of its rounding."""
        names, unit = columns.columns, columns.unit
        radian = si_factor(unit, "rad")
        metre = si_factor(columns.height_unit or "m", "m")
        latitude = table[:, 0] * radian
        longitude = table[:, 1] * radian
        height = table[:, 2] * metre
        self.refuse(
            np.abs(latitude) > 0.5 * math.pi + 1e-12,
            lambda k: f"{names[0]}: {table[k, 0]:g} {unit} is no latitude",
        )
        self.refuse(
            np.abs(longitude) > 2.0 * math.pi + 1e-12,
            lambda k: f"{names[1]}: {table[k, 1]:g} {unit} is no longitude",
        )
        r_e = frames.ecef_from_geodetic(latitude, longitude, height)
        r_i = frames.eci_from_ecef(r_e, self.theta)
        north = radian * SEMI_MAJOR
        east = north * float(np.cos(latitude[0]))
        return r_i, _largest_rounding(table, north, east, metre)

    def velocities(self, columns: VelocityColumns, r_i: Floats) -> tuple[Floats, float]:
        """Return v_i (n, 3) and one sigma of its rounding."""
        table = self.table(columns.columns)
        factor = si_factor(columns.unit, "m/s")
        v = table * factor
        speed = np.linalg.norm(v, axis=1)
        self.refuse(speed > _FASTEST, lambda k: f"a speed of {speed[k] * 1e-3:.6g} km/s; is the unit right?")
        noise = _largest_rounding(table, factor, factor, factor)
        if columns.frame in ("eci", "j2000"):
            return self.inertial(v, columns.frame), noise
        r_e = frames.ecef_from_eci(r_i, self.theta)
        if columns.frame == "ned":
            latitude, longitude, _ = frames.geodetic_from_ecef(r_e)
            C_e_n = frames.rotation_e_n(latitude, longitude)
            v = np.einsum("kji,kj->ki", C_e_n, v)
        earth_rotation = np.cross([0.0, 0.0, OMEGA], r_e)
        v_i = frames.eci_from_ecef(v + earth_rotation, self.theta)
        return v_i, noise

    def attitudes(self, columns: AttitudeColumns, r_i: Floats) -> tuple[Floats, float]:
        """Return q_b_i (n, 4), of continuous sign, and one sigma of its rounding in rad."""
        C_body, noise = self._matrices(columns)
        if columns.frame in ("eci", "j2000"):
            inertial_axes = self.inertial(np.eye(3), columns.frame)
            C_frame = np.broadcast_to(inertial_axes, C_body.shape)
        elif columns.frame == "ned":
            C_frame = frames.rotation_i_n(r_i, self.theta)
        else:
            C_frame = frames.rotation_i_e(self.theta)
        C_b_i = np.einsum("kji,kjl->kil", C_frame, C_body)
        return frames.quaternions(np.asarray(C_b_i)), noise

    def _matrices(self, columns: AttitudeColumns) -> tuple[Floats, float]:
        """Return the matrices (n, 3, 3) from body components to those of the attitude's frame, and the rounding."""
        table = self.table(columns.columns)
        if columns.form == "euler":
            radian = si_factor(columns.unit or "rad", "rad")
            angles = table * radian  # yaw, pitch, roll
            C = Rotation.from_euler("ZYX", angles).as_matrix()
            return np.asarray(C), _largest_rounding(table, radian, radian, radian)
        if columns.form == "quaternion":
            q = table if columns.scalar == "first" else table[:, [3, 0, 1, 2]]
            length = np.linalg.norm(q, axis=1)
            is_skewed = np.abs(length - 1.0) > _SKEW
            self.refuse(is_skewed, lambda k: f"the quaternion has length {length[k]:.6g}, not 1")
            C = frames.matrices(q / length[:, None])
            noise = 2.0 * _largest_rounding(table, *[1.0] * 4)
        else:
            C = table.reshape(-1, 3, 3)
            noise = _largest_rounding(table, *[1.0] * 9)
            square = C @ np.swapaxes(C, 1, 2)
            skew = np.max(np.abs(square - np.eye(3)), axis=(1, 2))
            is_mirrored = np.linalg.det(C) < 0.0
            is_skewed = (skew > _SKEW) | is_mirrored
            self.refuse(is_skewed, lambda k: f"the matrix is no rotation (off by {skew[k]:.3g})")
        if columns.turns != "body_to_frame":
            C = np.swapaxes(C, 1, 2)
        return np.asarray(C), noise


def _column_names(card: TableTrajectory) -> list[str]:
    """Return the names of the columns that a card uses, without repetition."""
    names = [card.time.column]
    for columns in (card.position, card.velocity, card.attitude):
        if columns is not None:
            names += columns.columns
    return list(dict.fromkeys(names))
