"""Recorded errors of a receiver from a user's file: card, rows, and errors along a flight."""

from collections.abc import Iterator
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.data_file import read_columns, refuse_first, refuse_unordered
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import rotation_i_e, rotation_i_n
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import Card, Fraction, Pause
from lvnav_trade.trajectory.files.columns import LengthUnit, SpeedUnit, Three, TimeColumn
from lvnav_trade.trajectory.files.row_fit import file_digest
from lvnav_trade.trajectory.files.rows import si_factor

FEWEST = 2
MOST_STARTS = 400
_LARGEST = 1e6  # m; with larger values the columns are positions, not errors
_FASTEST = 2e4  # m/s; with larger values the columns are not velocity errors
_GAP = 3.0  # times the median interval
_SLACK = 1e-6  # s; tolerance of the first and last time
_ENDINGS = {"m": ("km", "cm", "mm", "m"), "m/s": ("km_s", "cm_s", "mm_s", "m_s")}


class _ErrorColumns(Card):
    """Three columns of error, and their unit."""

    SI: ClassVar[str]

    columns: Three = Field(description="north, east, down; or x, y, z")
    unit: str | None

    def _faults(self) -> Iterator[str]:
        if not self.column_unit:
            names = ", ".join(self.columns)
            endings = ", ".join(f"_{ending}" for ending in _ENDINGS[self.SI])
            yield f"unit is missing, and the columns {names} do not all end in one of {endings}"

    @property
    def column_unit(self) -> str:
        """Unit of the card, or else the common ending of the columns' names."""
        if self.unit:
            return self.unit
        for ending in _ENDINGS[self.SI]:
            if all(name.endswith(f"_{ending}") for name in self.columns):
                return ending.replace("_", "/")
        return ""


class PositionErrorColumns(_ErrorColumns):
    """Three columns of position error along the axes of the table's frame."""

    SI = "m"

    unit: LengthUnit | None = Field(None, description="unit; none: from the names of the columns, such as north_m")


class VelocityErrorColumns(_ErrorColumns):
    """Three columns of velocity error along the axes of the table's frame."""

    SI = "m/s"

    unit: SpeedUnit | None = Field(None, description="unit; none: from the names of the columns, such as east_cm_s")


class ErrorTable(Card):
    """Errors of a receiver's solution recorded over time in a user's file, CSV or Parquet.

    Errors are linear between rows. The velocity is relative to the Earth in frames ecef and ned, and inertial in frame
    eci; ned refers to the true position. With several starts each run begins at one of that number of equally spaced
    points of the recording. With a single start all runs have the same errors, which are part of the mean in linear
    covariance.
    """

    file: str = Field(
        description="file with the rows: Parquet (.parquet, .pq) or CSV", json_schema_extra={"path": True}
    )
    delimiter: str = Field(",", min_length=1, max_length=1, description="separator of the fields of a CSV file")
    frame: Literal["ned", "ecef", "eci"]  # axes of the error columns
    time: TimeColumn  # column of time
    position: PositionErrorColumns  # columns of the position error
    velocity: VelocityErrorColumns | None = Field(None, description="none: the velocity has no recorded error")
    truth_minus_solution: bool = Field(False, description="sign of the columns; false: solution minus truth")
    factor: Fraction = Field(1.0, description="factor on all errors")
    largest_gap: Pause | None = Field(
        None, description="largest interval between rows; none: three times their median interval"
    )
    outside: Literal["refuse", "zero", "repeat"] = Field(
        "refuse", description="errors before the first row and after the last one"
    )
    starts: int = Field(
        1, ge=1, le=MOST_STARTS, description="number of places in the recording at which a run may start"
    )

    def _faults(self) -> Iterator[str]:
        if self.starts > 1 and self.outside != "repeat":
            yield "starts: a recording that is begun anywhere goes on at its beginning: set outside: repeat"


class ErrorRecording(NamedTuple):
    """Rows of a recording.

    t : (n,) s since lift-off.
    errors : (n, 6) m, m/s. Errors of position and velocity, solution minus truth, in the frame of the table.
    period : s. Time after which the recording repeats.
    """

    t: Floats
    errors: Floats
    period: float


def recording(card: ErrorTable) -> ErrorRecording:
    """Return the rows of a card's file; InputError names file, row and error."""
    return _recording((card.model_dump_json(), file_digest(card.file)), card)


@result_cache(4)
def _recording(identity: tuple[str, str], card: ErrorTable) -> ErrorRecording:
    """Return the rows of a card, cached by `identity`: the card and the digest of its file."""
    names = [card.time.column, *card.position.columns]
    if card.velocity is not None:
        names += card.velocity.columns
    names = list(dict.fromkeys(names))
    table, places = read_columns(card.file, names, card.delimiter, FEWEST, "a recording")
    time_column = table[:, names.index(card.time.column)]
    t = (time_column - card.time.liftoff) * si_factor(card.time.unit, "s")
    interval = refuse_unordered(t, card.file, places)
    median = float(np.median(interval))
    largest = _GAP * median if card.largest_gap is None else card.largest_gap
    refuse_first(
        interval > largest + 1e-9,
        card.file,
        places[1:],
        lambda k: (
            f"no rows between {t[k]:g} s and {t[k + 1]:g} s, a gap longer than {largest:g} s (state largest_gap "
            f"if a straight line is good enough)"
        ),
    )
    errors = np.zeros((t.size, 6))
    errors[:, :3] = _read_errors(table, names, card.position, card.truth_minus_solution)
    if card.velocity is not None:
        errors[:, 3:] = _read_errors(table, names, card.velocity, card.truth_minus_solution)
    _refuse_large(errors, card.file, places)
    period = float(t[-1] - t[0]) + median
    return ErrorRecording(t, errors * card.factor, period)


def _read_errors(table: Floats, names: list[str], columns: _ErrorColumns, truth_minus_solution: bool) -> Floats:
    """Return the errors of three columns of a table, solution minus truth, (n, 3) SI.

    Parameters
    ----------
    table : (n, n_column)
        Columns of the file.
    names : list of str, n_column
        Names of the columns.
    columns : _ErrorColumns
        Columns to read, and their unit.
    truth_minus_solution : bool
        Whether the file has the opposite sign.
    """
    indices = [names.index(name) for name in columns.columns]
    values = table[:, indices]
    sign = -1.0 if truth_minus_solution else 1.0
    scale = si_factor(columns.column_unit, columns.SI)
    return np.asarray(values * scale * sign)


def _refuse_large(errors: Floats, file: str, places: list[str]) -> None:
    """Raise InputError at the first row of errors (n, 6) that cannot be errors of position or velocity."""
    with np.errstate(over="ignore"):  # an infinite size is refused as any other beyond the bound
        size = np.linalg.norm(errors[:, :3], axis=1)
        speed = np.linalg.norm(errors[:, 3:], axis=1)
    refuse_first(
        size > _LARGEST,
        file,
        places,
        lambda k: f"a position error of {size[k] * 1e-3:.6g} km; do the columns hold positions?",
    )
    refuse_first(
        speed > _FASTEST,
        file,
        places,
        lambda k: f"a velocity error of {speed[k] * 1e-3:.6g} km/s; is the unit right?",
    )


def refuse_short(card: ErrorTable, start: float, end: float) -> None:
    """Refuse a recording that does not cover the flight.

    Parameters
    ----------
    card : ErrorTable
    start, end : float
        Start and end of the flight (s since lift-off).

    Raises
    ------
    InputError
        The file cannot be read, or with `outside: refuse` does not cover the flight.
    """
    rows = recording(card)
    if card.outside == "refuse" and (start < rows.t[0] - _SLACK or end > rows.t[-1] + _SLACK):
        raise InputError(
            f"{card.file}: rows from {rows.t[0]:g} to {rows.t[-1]:g} s, the flight is from {start:g} to {end:g} s: set "
            f"outside to zero or repeat"
        )


def sample_errors(card: ErrorTable, t: Floats) -> Floats:
    """Return the errors of each start at given times, (n_start, n, 6) m and m/s, frame of the table.

    Parameters
    ----------
    card : ErrorTable
    t : (n,) s since lift-off
    """
    rows = recording(card)
    times = rows.t
    errors = rows.errors
    sample_times = t[None, :]
    if card.outside == "repeat":
        start_shifts = rows.period * np.arange(card.starts) / card.starts
        table_time = t[None, :] + start_shifts[:, None] - times[0]
        sample_times = times[0] + np.mod(table_time, rows.period)
        # the first row again, after a period
        times = np.append(times, times[0] + rows.period)
        errors = np.vstack([errors, errors[:1]])
    columns = [np.interp(sample_times, times, column) for column in errors.T]
    samples = np.stack(columns, axis=-1)
    if card.outside == "zero":
        is_before = sample_times < times[0] - _SLACK
        is_after = sample_times > times[-1] + _SLACK
        samples[is_before | is_after] = 0.0
    return samples


def inertial_errors(errors: Floats, frame: str, r_i: Floats, theta: Floats) -> Floats:
    """Return errors of position and velocity in frame i, (..., n, 6).

    A position error d in Earth-fixed axes adds OMEGA x d to the error of the inertial velocity.

    Parameters
    ----------
    errors : (..., n, 6) m, m/s
        Errors in the axes of `frame`.
    frame : {"ned", "ecef", "eci"}
    r_i : (n, 3) m, frame i
        True positions.
    theta : (n,) rad
        Earth angles.
    """
    if frame == "eci":
        return errors
    rotation_from_i = rotation_i_e(theta) if frame == "ecef" else rotation_i_n(r_i, theta)
    position = np.einsum("nji,...nj->...ni", rotation_from_i, errors[..., :3])
    velocity = np.einsum("nji,...nj->...ni", rotation_from_i, errors[..., 3:])
    inertial_velocity = velocity + np.cross([0.0, 0.0, OMEGA], position)
    return np.concatenate([position, inertial_velocity], axis=-1)
