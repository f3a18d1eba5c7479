"""Rows of a user's file: position, velocity and attitude in frame i."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.data_file import FEWEST, read_columns, refuse_first, refuse_unordered
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import coarse, restored
from lvnav_trade.quantities.units import parse
from lvnav_trade.trajectory.discontinuities import RowGap, bridged, described
from lvnav_trade.trajectory.files.columns import AttitudeColumns, PositionColumns, TableTrajectory, VelocityColumns
from lvnav_trade.trajectory.files.j2000 import rotation_to_date

LONGEST_HOLE = 1.0  # s; longest gap that a spline bridges, as long as the row interval of some files
_LARGEST_TURN = 1.0  # rad in a gap; the direction of a rotation near half a turn is ambiguous


def usable(t: Floats, events: Mapping[str, float], path: str, places: list[str]) -> tuple[int, list[RowGap], list[str]]:
    """Return the number of usable rows at times t (n,) s, the gaps between them, and remarks on both.

    The flight ends at a gap that is too long to be bridged, if that is after the last event.

    Raises
    ------
    InputError
        Times repeat or decrease, or such a gap is before the last event.
    """
    refuse_unordered(t, path, places)
    short, last = bridged(t, max(events.values(), default=math.inf), LONGEST_HOLE, path, places)
    if last is None:
        return t.size, short, described(short)
    span = f"{last.start:.6g} to {last.end:.6g} s"
    return (
        last.row + 1,
        short,
        [
            *described(short),
            f"no data from {span}, after the last event: the flight ends there and the rows behind it are left out",
        ],
    )


def pairs(card: TableTrajectory) -> list[float]:
    """Return the times (s) with two different rows, before and after an event that the card may declare."""
    names = [card.time.column, *card.position.columns, *(() if card.velocity is None else card.velocity.columns)]
    table, _ = read_columns(card.file, names, card.delimiter)
    table = table[~np.append(False, np.all(table[1:] == table[:-1], axis=1))]
    repeated = np.flatnonzero(np.diff(table[:, 0]) == 0.0)
    return list(dict.fromkeys(((table[repeated, 0] - card.time.liftoff) * si(card.time.unit, "s")).tolist()))


def doubled(t: Floats, events: Mapping[str, float]) -> NDArray[np.bool_]:
    """Return which rows at times t (n,) s are the first of two rows at the time of an event, (n,) bool."""
    first = np.append(np.diff(t) == 0.0, False)
    first[1:] &= ~first[:-1]  # a third row of a time repeats it
    times = np.array([*events.values()])
    near = np.min(np.abs(t[:, None] - times), axis=1, initial=math.inf) < SAME
    return np.asarray(first & near)


def _refuse_repeated(
    t: Floats, before: NDArray[np.bool_], card: TableTrajectory, places: list[str], apart: float
) -> None:
    """Raise InputError if two rows have the same time t (n,) and the first is not `before` (n,) an event.

    apart : Spacing of times of single precision, in the unit of the column; zero for times with all digits.
    """
    for k in np.flatnonzero((np.diff(t) == 0.0) & ~before[:-1])[:1].tolist():
        here = f"{card.file}:{places[k + 1]}: time {t[k]:.9g} s repeats that of the row before"
        if apart > 0.0:
            raise InputError(f"{here}: column {card.time.column!r}: {coarse(apart, card.time.unit)}")
        raise InputError(
            f"{here}, with another state: if an event is there, declare it (events: {{NAME: {t[k]:.9g} s}}); if not, "
            "remove one of the two rows"
        )


def rounding(column: Floats) -> float:
    """Return one sigma of the rounding of a column's numbers, estimated from their digits; zero for full precision."""
    if np.all(column == column[0]):
        return 0.0
    largest = float(np.max(np.abs(column)))
    single = 0.0
    with np.errstate(over="ignore"):
        if np.all(column.astype(np.float32) == column):  # single precision, possibly with few digits as well
            single = float(np.spacing(np.float32(largest))) / math.sqrt(12.0)
    for digits in range(-3, 10):
        scaled = column * 10.0**digits
        if largest * 10.0**digits > 2.0**40:  # a double has hardly a digit more to round
            break
        if np.ptp(scaled) >= 1.0 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-3):
            return max(single, 10.0**-digits / math.sqrt(12.0))
    return single


_NEAREST, _FARTHEST = 6.3e6, 1e9  # m from the centre of the Earth; positions outside have a wrong unit
_FASTEST = 2e4  # m/s
SAME = 1e-6  # s; times closer than this count as equal
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
    read = _ColumnReader(card)
    r_i, noise_r = read.positions(card.position)
    v_i, noise_v = (None, 0.0) if card.velocity is None else read.velocities(card.velocity, r_i)
    q_b_i, noise_q = (None, 0.0) if card.attitude is None else read.attitudes(card.attitude, r_i)
    noise_r, noise_v = read.with_late_stamps((r_i, noise_r), (v_i, noise_v))
    seen, stated = (noise_r, noise_v, noise_q), (card.position_noise, card.velocity_noise, card.attitude_noise)
    noise = tuple(rounded if sigma is None else sigma for rounded, sigma in zip(seen, stated, strict=True))
    read.refuse_jumps(card.events, (r_i, v_i, q_b_i), noise)
    kept = ~read.before
    rows = TrajectoryRows(
        read.t[kept],
        r_i[kept],
        None if v_i is None else v_i[kept],
        None if q_b_i is None else q_b_i[kept],
        noise,
        read.theta0,
        tuple(read.notes),
    )
    if rows.q_b_i is not None:
        read.refuse_lost_turns(rows.t, rows.q_b_i)
    return rows


def read_attitudes(card: TableTrajectory, parts: Sequence[AttitudeColumns], r_i: Floats) -> list[Floats | None]:
    """Return q_b_i (n, 4) of the rows for each interpretation of the attitude columns.

    The result is None for an interpretation in which the columns are no attitude.

    r_i : (n, 3) m. Positions of the rows.
    """
    read, attitudes = _ColumnReader(card), list[Floats | None]()
    positions = r_i[np.cumsum(~read.before) - 1 + read.before]  # both rows of an event have that of the second
    for part in parts:
        try:
            attitudes.append(read.attitudes(part, positions)[0][~read.before])
        except InputError:
            attitudes.append(None)
    return attitudes


def si(unit: str, base: str) -> float:
    """Return the size of a unit in the SI unit `base`."""
    return parse(f"1 {unit}", base)


def _rounding(table: Floats, *factors: float) -> float:
    return max(rounding(column) * factor for column, factor in zip(table.T, factors, strict=True))


class _ColumnReader:
    """Columns of a card's file by name, with times t (n,) s and Earth angles theta (n,).

    before : (n,). First rows of pairs at a declared event; they end the phase before it and are not used otherwise.
    late : s. One sigma of the rounding of the times.
    """

    def __init__(self, card: TableTrajectory) -> None:
        parts = [part for part in (card.position, card.velocity, card.attitude) if part is not None]
        names = list(dict.fromkeys([card.time.column, *(name for part in parts for name in part.columns)]))
        table, self.places = read_columns(card.file, names, card.delimiter)
        # rows equal to the row before, as in files whose phases end and begin with the same state
        equal = np.append(False, np.all(table[1:] == table[:-1], axis=1))
        table, self.places = table[~equal], [place for place, drop in zip(self.places, equal, strict=True) if not drop]
        stamps, second = restored(table[:, names.index(card.time.column)], card.time.unit), si(card.time.unit, "s")
        t, self.late = (stamps.column - card.time.liftoff) * second, stamps.sigma * second
        self.before = doubled(t, card.events)
        _refuse_repeated(t, self.before, card, self.places, stamps.apart)
        kept = np.flatnonzero(~self.before)
        count, self.holes, self.notes = usable(t[kept], card.events, card.file, [self.places[k] for k in kept.tolist()])
        if count < FEWEST:
            ended = f"before {self.notes[-1]}" if self.notes else "of different times"
            raise InputError(f"{card.file}: {count} rows {ended}; a trajectory needs {FEWEST} or more")
        self.notes += [stamps.note] if stamps.note else []
        if np.any(equal):
            number = int(np.sum(equal))
            rows = f"{number} row{'s' if number > 1 else ''}"
            self.notes = [*self.notes, f"{rows} equal to the row before left out"]
        last = int(kept[count - 1]) + 1
        self.file, self.column = card.file, dict(zip(names, table[:last].T, strict=True))
        self.t, self.before = t[:last], self.before[:last]
        self.theta0 = frames.gmst(card.epoch)
        self.theta = frames.earth_angle(self.theta0, self.t)
        # angle about z from frame i to the inertial axes of the file
        self.turn = 0.0 if card.greenwich is None else self.theta0 - card.greenwich
        self.epoch = card.epoch

    def inertial(self, v: Floats, frame: str) -> Floats:
        """Return vectors (n, 3) of frame eci or j2000 in frame i."""
        if frame == "j2000":
            return np.asarray(v @ rotation_to_date(self.epoch).T)
        return frames.eci_from_ecef(v, self.turn)

    def table(self, names: tuple[str, ...]) -> Floats:
        return np.column_stack([self.column[name] for name in names])

    def refuse(self, wrong: NDArray[np.bool_], fault: Callable[[int], str]) -> None:
        """Raise InputError for the first row that is wrong (n,)."""
        refuse_first(wrong, self.file, self.places, fault)

    def with_late_stamps(self, position: tuple[Floats, float], velocity: tuple[Floats | None, float]) -> list[float]:
        """Return one sigma of position and velocity with the effect of rounded times.

        position, velocity : Rows (n, 3) and their sigma without that effect.
        """
        if self.late == 0.0:
            return [position[1], velocity[1]]
        single, sigmas = ~self.before, []
        for rows, noise in (position, velocity):
            change = np.zeros(1) if rows is None else np.linalg.norm(np.diff(rows[single], axis=0), axis=1)
            rate = float(np.median(change / np.diff(self.t[single]))) if rows is not None else 0.0
            sigmas.append(math.hypot(noise, rate * self.late))
        return sigmas

    def refuse_jumps(
        self, events: Mapping[str, float], motion: tuple[Floats, Floats | None, Floats | None], noise: tuple[float, ...]
    ) -> None:
        """Raise InputError if velocity or attitude differ between the two rows of an event.

        Only the force and the reference point of the position can jump.

        motion : r_i (n, 3) m, v_i (n, 3) m/s and q_b_i (n, 4) of all rows.
        noise : As in `TrajectoryRows`.
        """
        r_i, v_i, q_b_i = motion
        for k in np.flatnonzero(self.before).tolist():
            name = min(events, key=lambda event: abs(events[event] - self.t[k]))
            jumps = [] if v_i is None else [("velocity", float(np.linalg.norm(v_i[k + 1] - v_i[k])), noise[1], "m/s")]
            if q_b_i is not None:
                cosine = min(1.0, abs(float(q_b_i[k + 1] @ q_b_i[k])))
                jumps.append(("attitude", 2.0 * math.acos(cosine), noise[2], "rad"))
            # difference of the Earth's velocity between two reference points
            turned = OMEGA * float(np.linalg.norm(r_i[k + 1] - r_i[k]))
            for what, size, sigma, unit in jumps:
                if size > _JUMP + 10.0 * sigma + turned:
                    raise InputError(
                        f"{self.file}:{self.places[k + 1]}: the {what} jumps by {size:.3g} {unit} at event {name!r}, "
                        f"between the two rows at {self.t[k]:.9g} s: only the force can jump; spread the change over "
                        "the time that it takes, or remove one of the two rows"
                    )

    def refuse_lost_turns(self, t: Floats, q_b_i: Floats) -> None:
        """Raise InputError for a gap in which the body may turn so far that the direction is ambiguous.

        The rate in the gap is assumed to be the larger of those before and after it; t (n,) s, q_b_i (n, 4).
        """
        angle = 2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(q_b_i[1:] * q_b_i[:-1], axis=1))))
        rate = angle / np.diff(t)
        for hole in self.holes:
            turn = hole.length * max(rate[k] for k in (hole.row - 1, hole.row + 1) if 0 <= k < rate.size)
            if turn > _LARGEST_TURN:
                raise InputError(
                    f"{self.file}:{self.places[hole.row + 1]}: no data between {hole.start:g} s and {hole.end:g} s, "
                    f"in which the body turns by about {math.degrees(turn):.0f} deg: give the attitude in between"
                )

    def positions(self, part: PositionColumns) -> tuple[Floats, float]:
        """Return r_i (n, 3) and one sigma of its rounding."""
        table = self.table(part.columns)
        if part.frame == "geodetic":
            angle, length = si(part.unit, "rad"), si(part.height_unit or "m", "m")
            latitude, longitude, height = table[:, 0] * angle, table[:, 1] * angle, table[:, 2] * length

            def no(what: str, at: int) -> Callable[[int], str]:
                return lambda k: f"{part.columns[at]}: {table[k, at]:g} {part.unit} is no {what}"

            self.refuse(np.abs(latitude) > 0.5 * math.pi + 1e-12, no("latitude", 0))
            self.refuse(np.abs(longitude) > 2.0 * math.pi + 1e-12, no("longitude", 1))
            r_i = frames.eci_from_ecef(frames.ecef_from_geodetic(latitude, longitude, height), self.theta)
            factors = (angle * SEMI_MAJOR, angle * SEMI_MAJOR * float(np.cos(latitude[0])), length)
        else:
            factors = (si(part.unit, "m"),) * 3
            r = table * factors[0]
            r_i = frames.eci_from_ecef(r, self.theta) if part.frame == "ecef" else self.inertial(r, part.frame)
        distance = np.linalg.norm(r_i, axis=1)
        self.refuse(
            (distance < _NEAREST) | (distance > _FARTHEST),
            lambda k: f"the position is {distance[k] * 1e-3:.6g} km from the Earth's centre; is the unit right?",
        )
        return r_i, _rounding(table, *factors)

    def velocities(self, part: VelocityColumns, r_i: Floats) -> tuple[Floats, float]:
        """Return v_i (n, 3) and one sigma of its rounding."""
        table, factor = self.table(part.columns), si(part.unit, "m/s")
        v = table * factor
        speed = np.linalg.norm(v, axis=1)
        self.refuse(speed > _FASTEST, lambda k: f"a speed of {speed[k] * 1e-3:.6g} km/s; is the unit right?")
        noise = _rounding(table, *[factor] * 3)
        if part.frame in ("eci", "j2000"):
            return self.inertial(v, part.frame), noise
        r_e = frames.ecef_from_eci(r_i, self.theta)
        if part.frame == "ned":
            latitude, longitude, _ = frames.geodetic_from_ecef(r_e)
            v = np.einsum("kji,kj->ki", frames.rotation_e_n(latitude, longitude), v)
        return frames.eci_from_ecef(v + np.cross([0.0, 0.0, OMEGA], r_e), self.theta), noise

    def attitudes(self, part: AttitudeColumns, r_i: Floats) -> tuple[Floats, float]:
        """Return q_b_i (n, 4), of continuous sign, and one sigma of its rounding in rad."""
        C, noise = self._matrices(part)
        if part.frame in ("eci", "j2000"):
            C_i = np.broadcast_to(self.inertial(np.eye(3), part.frame), C.shape)
        else:
            C_i = frames.rotation_i_n(r_i, self.theta) if part.frame == "ned" else frames.rotation_i_e(self.theta)
        return frames.quaternions(np.asarray(np.einsum("kji,kjl->kil", C_i, C))), noise

    def _matrices(self, part: AttitudeColumns) -> tuple[Floats, float]:
        """Return the matrices (n, 3, 3) from body components to those of the attitude's frame, and the rounding."""
        table = self.table(part.columns)
        if part.form == "euler":
            factor = si(part.unit or "rad", "rad")
            return _from_euler(table * factor), _rounding(table, *[factor] * 3)
        if part.form == "quaternion":
            q = table if part.scalar == "first" else table[:, [3, 0, 1, 2]]
            length = np.linalg.norm(q, axis=1)
            skewed = np.abs(length - 1.0) > _SKEW
            self.refuse(skewed, lambda k: f"the quaternion has length {length[k]:.6g}, not 1")
            C, noise = frames.matrices(q / length[:, None]), 2.0 * _rounding(table, *[1.0] * 4)
        else:
            C, noise = table.reshape(-1, 3, 3), _rounding(table, *[1.0] * 9)
            skew = np.max(np.abs(C @ np.swapaxes(C, 1, 2) - np.eye(3)), axis=(1, 2))
            skewed = (skew > _SKEW) | (np.linalg.det(C) < 0.0)
            self.refuse(skewed, lambda k: f"the matrix is no rotation (off by {skew[k]:.3g})")
        return np.asarray(C if part.turns == "body_to_frame" else np.swapaxes(C, 1, 2)), noise


def _from_euler(angles: Floats) -> Floats:
    """Return the matrices (n, 3, 3), body to frame, of yaw, pitch, roll (n, 3) in rad."""
    return np.asarray(Rotation.from_euler("ZYX", angles).as_matrix())
