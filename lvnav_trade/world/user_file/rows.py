"""Rows of a user's file, CSV or Parquet: columns of numbers, and position, velocity and attitude in frame i."""

import csv
import difflib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade import frames
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.input_files import text_lines
from lvnav_trade.kernels.earth import OMEGA, SEMI_MAJOR
from lvnav_trade.limits import DATA_BYTES, DATA_ROWS, FIELD_LENGTH
from lvnav_trade.records import Floats
from lvnav_trade.units import parse
from lvnav_trade.world.holes import Hole, bridged, described
from lvnav_trade.world.user_file.columns import AttitudeColumns, PositionColumns, TableTrajectory, VelocityColumns

FEWEST = 12  # rows from which a flight can be rebuilt
LONGEST_HOLE = 1.0  # s that a spline bridges whatever the rate: rows of a whole ascent may be as far apart
_LARGEST_TURN = 1.0  # rad in a hole; half a turn would leave open which way the body turned


def read_columns(
    path: str, names: list[str], delimiter: str, fewest: int = FEWEST, what: str = "a trajectory"
) -> tuple[Floats, list[str]]:
    """Return the columns `names` of a CSV or Parquet file (n, n_name), and where each row stands, for messages.

    A name that ends in .parquet or .pq is Parquet; anything else is text with one line of headers, in which lines that
    begin with # are comments. InputError names file, row and fault: no such file, no such column, a field that is no
    finite number, fewer rows than `what` they are of needs.
    """
    binary = Path(path).suffix.lower() in (".parquet", ".pq")
    table, places = _parquet(path, names) if binary else _text(path, names, delimiter)
    if len(table) < fewest:
        raise InputError(f"{path}: {len(table)} rows of data, {what} needs {fewest} or more")
    for row, column in np.argwhere(~np.isfinite(table))[:1]:
        raise InputError(f"{path}:{places[row]}: {names[column]} is {table[row, column]}, not a finite number")
    return table, places


def read_texts(path: str, name: str, delimiter: str = ",") -> list[str]:
    """Return a column of texts of a file that `read_columns` has read, row by row."""
    if Path(path).suffix.lower() in (".parquet", ".pq"):
        import pyarrow.parquet as pq

        _refuse_missing(path, [name], list(pq.ParquetFile(path).schema_arrow.names))
        return [str(value) for value in pq.read_table(path, columns=[name]).column(0).to_pylist()]
    lines = text_lines(path, DATA_BYTES)
    number, header = next(lines)
    titles = [title.strip() for title in _fields(header, delimiter, f"{path}:{number}")]
    _refuse_missing(f"{path}:{number}", [name], titles)
    at = titles.index(name)
    return [_fields(line, delimiter, f"{path}:{number}")[at].strip() for number, line in lines]


def column_names(path: str, delimiter: str = ",") -> list[str]:
    """Return the names of the columns of a CSV or Parquet file; InputError where it cannot be read."""
    if Path(path).suffix.lower() not in (".parquet", ".pq"):
        number, header = next(text_lines(path, DATA_BYTES), (0, ""))
        return [title.strip() for title in _fields(header, delimiter, f"{path}:{number}")] if header else []
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return list(pq.ParquetFile(path).schema_arrow.names)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as Parquet: {str(error).partition(chr(10))[0]}") from None


def refuse_first(wrong: NDArray[np.bool_], path: str, places: list[str], fault: Callable[[int], str]) -> None:
    """InputError with place and fault of the first row that is wrong (n,)."""
    for k in np.flatnonzero(wrong)[:1]:
        raise InputError(f"{path}:{places[k]}: {fault(int(k))}")


def _parquet(path: str, names: list[str]) -> tuple[Floats, list[str]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path)
        _refuse_missing(path, names, list(file.schema_arrow.names))
        if file.metadata.num_rows > DATA_ROWS:
            raise InputError(f"{path}: {file.metadata.num_rows} rows; at most {DATA_ROWS} are read")
        table = file.read(columns=names)
        columns = [table.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False) for name in names]
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read as Parquet: {str(error).partition(chr(10))[0]}") from None
    return np.column_stack(columns).astype(float), [f"row {number}" for number in range(1, table.num_rows + 1)]


def _text(path: str, names: list[str], delimiter: str) -> tuple[Floats, list[str]]:
    lines = text_lines(path, DATA_BYTES)
    number, header = next(lines, (0, ""))
    if not header:
        raise InputError(f"{path}: is empty")
    titles = [title.strip() for title in _fields(header, delimiter, f"{path}:{number}")]
    _refuse_missing(f"{path}:{number}", names, titles)
    at = [titles.index(name) for name in names]
    rows: list[list[float]] = []
    places: list[str] = []
    for number, line in lines:
        fields = _fields(line, delimiter, f"{path}:{number}")
        if len(fields) != len(titles):
            raise InputError(f"{path}:{number}: {len(fields)} fields, the header has {len(titles)}")
        rows.append([_number(fields[k], titles[k], f"{path}:{number}") for k in at])
        if len(rows) > DATA_ROWS:
            raise InputError(f"{path}:{number}: more than {DATA_ROWS} rows")
        places.append(str(number))
    return np.array(rows, dtype=float).reshape(len(rows), len(names)), places


def _fields(line: str, delimiter: str, where: str) -> list[str]:
    """Return the fields of a line; InputError where one is longer than any number or name."""
    longest = max(map(len, line.split(delimiter))) if len(line) > FIELD_LENGTH else 0
    if longest > FIELD_LENGTH:
        raise InputError(f"{where}: a field of {longest} characters; at most {FIELD_LENGTH} are read")
    try:
        return next(csv.reader([line], delimiter=delimiter))
    except csv.Error as error:
        raise InputError(f"{where}: {error}") from None


def _refuse_missing(where: str, names: list[str], titles: list[str]) -> None:
    for name in names:
        if name not in titles:
            near = difflib.get_close_matches(name, titles, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(titles[:20])}"
            raise InputError(f"{where}: no column {quoted(name)} ({hint})")
        if titles.count(name) > 1:
            raise InputError(f"{where}: column {name!r} stands {titles.count(name)} times")


def _number(field: str, title: str, where: str) -> float:
    try:
        return float(field)
    except ValueError:
        raise InputError(f"{where}: {title} is {quoted(field.strip())}, not a number") from None


def refuse_unordered(t: Floats, path: str, places: list[str]) -> Floats:
    """Return the intervals (n - 1,) between times t (n,) in s; InputError where they repeat or go back."""
    interval = np.diff(t)
    for k in np.flatnonzero(interval <= 0.0)[:1]:
        fault = "repeats" if interval[k] == 0.0 else "goes back from"
        raise InputError(f"{path}:{places[k + 1]}: time {t[k + 1]:.9g} s {fault} {t[k]:.9g} s of the row before")
    return interval


def usable(t: Floats, events: Mapping[str, float], path: str, places: list[str]) -> tuple[int, list[Hole], list[str]]:
    """Return how many rows at times t (n,) in s can be flown, the holes among them, and what is said of both.

    InputError where times repeat or go back, or leave a hole before the last event that is longer than what is bridged;
    such a hole behind it ends the flight.
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


def rounding(column: Floats) -> float:
    """Return one sigma of the rounding of a column's numbers, seen in their digits; zero where they carry them all."""
    if np.all(column == column[0]):
        return 0.0
    largest = float(np.max(np.abs(column)))
    for digits in range(-3, 10):
        scaled = column * 10.0**digits
        if largest * 10.0**digits > 2.0**40:  # a double has hardly a digit more to round
            break
        if np.ptp(scaled) >= 1.0 and np.all(np.abs(scaled - np.rint(scaled)) < 1e-3):
            return 10.0**-digits / math.sqrt(12.0)
    return 0.0


_NEAREST, _FARTHEST = 6.3e6, 1e9  # m from the centre of the Earth; what lies outside is a wrong unit
_FASTEST = 2e4  # m/s
_SKEW = 1e-3  # of a quaternion's length from one, or of a matrix from orthonormal


class Rows(NamedTuple):
    """Rows in SI, frame i: t (n,) s from lift-off, r_i (n, 3), v_i (n, 3) or none, q_b_i (n, 4) or none.

    noise: one sigma of a component of a row of position (m), velocity (m/s), attitude (rad); theta0: Earth angle at
    lift-off; notes: on holes.
    """

    t: Floats
    r_i: Floats
    v_i: Floats | None
    q_b_i: Floats | None
    noise: tuple[float, ...]
    theta0: float
    notes: tuple[str, ...] = ()


def read_rows(card: TableTrajectory) -> Rows:
    """Return the rows of a card's file; InputError names file, row and fault."""
    read = _Reader(card)
    r_i, noise_r = read.positions(card.position)
    v_i, noise_v = (None, 0.0) if card.velocity is None else read.velocities(card.velocity, r_i)
    q_b_i, noise_q = (None, 0.0) if card.attitude is None else read.attitudes(card.attitude, r_i)
    seen, stated = (noise_r, noise_v, noise_q), (card.position_noise, card.velocity_noise, card.attitude_noise)
    noise = (own if given is None else given for own, given in zip(seen, stated, strict=True))
    if q_b_i is not None:
        read.refuse_lost_turns(q_b_i)
    return Rows(read.t, r_i, v_i, q_b_i, tuple(noise), read.theta0, tuple(read.notes))


def si(unit: str, base: str) -> float:
    """Return how many of the SI unit `base` a unit is."""
    return parse(f"1 {unit}", base)


def _rounding(table: Floats, *factors: float) -> float:
    return max(rounding(column) * factor for column, factor in zip(table.T, factors, strict=True))


class _Reader:
    """The columns of a card's file by name, and the times t (n,) s with their Earth angles."""

    def __init__(self, card: TableTrajectory) -> None:
        parts = [part for part in (card.position, card.velocity, card.attitude) if part is not None]
        names = list(dict.fromkeys([card.time.column, *(name for part in parts for name in part.columns)]))
        table, self.places = read_columns(card.file, names, card.delimiter)
        t = (table[:, names.index(card.time.column)] - card.time.liftoff) * si(card.time.unit, "s")
        count, self.holes, self.notes = usable(t, card.events, card.file, self.places)
        if count < FEWEST:
            raise InputError(f"{card.file}: {count} rows before {self.notes[-1]}; a trajectory needs {FEWEST} or more")
        self.file, self.column = card.file, dict(zip(names, table[:count].T, strict=True))
        self.t = t[:count]
        self.theta0 = frames.gmst(card.epoch)
        self.theta = frames.earth_angle(self.theta0, self.t)
        # from the axes of frame i to the file's, about z
        self.turn = 0.0 if card.greenwich is None else self.theta0 - card.greenwich

    def table(self, names: tuple[str, ...]) -> Floats:
        return np.column_stack([self.column[name] for name in names])

    def refuse(self, wrong: NDArray[np.bool_], fault: Callable[[int], str]) -> None:
        """InputError with the fault of the first row that is wrong (n,)."""
        refuse_first(wrong, self.file, self.places, fault)

    def refuse_lost_turns(self, q_b_i: Floats) -> None:
        """InputError where the body, as fast as beside a hole, turns so far in it that the rows leave the turn open."""
        angle = 2.0 * np.arccos(np.minimum(1.0, np.abs(np.sum(q_b_i[1:] * q_b_i[:-1], axis=1))))
        rate = angle / np.diff(self.t)
        for hole in self.holes:
            turn = hole.length * max(rate[k] for k in (hole.row - 1, hole.row + 1) if 0 <= k < rate.size)
            if turn > _LARGEST_TURN:
                raise InputError(
                    f"{self.file}:{self.places[hole.row + 1]}: no data between {hole.start:g} s and {hole.end:g} s, "
                    f"in which the body turns by some {math.degrees(turn):.0f} deg"
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
            r_i = frames.eci_from_ecef(table * factors[0], self.theta if part.frame == "ecef" else self.turn)
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
        if part.frame == "eci":
            return frames.eci_from_ecef(v, self.turn), noise
        r_e = frames.ecef_from_eci(r_i, self.theta)
        if part.frame == "ned":
            latitude, longitude, _ = frames.geodetic_from_ecef(r_e)
            v = np.einsum("kji,kj->ki", frames.rotation_e_n(latitude, longitude), v)
        return frames.eci_from_ecef(v + np.cross([0.0, 0.0, OMEGA], r_e), self.theta), noise

    def attitudes(self, part: AttitudeColumns, r_i: Floats) -> tuple[Floats, float]:
        """Return q_b_i (n, 4), of continuous sign, and one sigma of its rounding in rad."""
        C, noise = self._matrices(part)
        if part.frame == "eci":
            C_i = np.broadcast_to(frames.rotation_i_e(self.turn), C.shape)
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
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
