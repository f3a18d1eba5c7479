"""Checks of the rows of a user's file: order of their times, gaps, pairs at events, and the rounding of numbers."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.data_file import refuse_unordered
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import coarse_message
from lvnav_trade.trajectory.discontinuities import RowGap, bridged_gaps, gap_remarks
from lvnav_trade.trajectory.files.columns import TableTrajectory

SAME = 1e-6  # s; times closer than this count as equal
LONGEST_HOLE = 1.0  # s; longest gap that a spline bridges, as long as the row interval of some files


def usable_rows(
    t: Floats, events: Mapping[str, float], path: str, places: list[str]
) -> tuple[int, list[RowGap], list[str]]:
    """Return the usable rows of a file.

    The trajectory ends at a gap that is too long to be bridged, if that is after the last event.

    Parameters
    ----------
    t : (n,) s
        Times of the rows.
    events : mapping
        Times of the events (s) by name.
    path : str
        Name of the file, for messages.
    places : list of str
        Line of each row, for messages.

    Returns
    -------
    n_row : int
        Number of usable rows.
    gaps : list of RowGap
        Gaps between them, which a spline bridges.
    remarks : list of str
        Remarks on the gaps and on the end.

    Raises
    ------
    InputError
        Times repeat or decrease, or a gap that is too long is before the last event.
    """
    refuse_unordered(t, path, places)
    last_event = max(events.values(), default=math.inf)
    gaps, last = bridged_gaps(t, last_event, LONGEST_HOLE, path, places)
    remarks = gap_remarks(gaps)
    if last is None:
        return t.size, gaps, remarks
    span = f"{last.start:.6g} to {last.end:.6g} s"
    remarks.append(
        f"no data from {span}, after the last event: the flight ends there and the rows behind it are left out"
    )
    return last.row + 1, gaps, remarks


def find_pair_starts(t: Floats, events: Mapping[str, float]) -> NDArray[np.bool_]:
    """Return which rows at times t (n,) s are the first of two rows at the time of an event, (n,) bool."""
    is_repeated = np.diff(t) == 0.0
    first = np.append(is_repeated, False)
    first[1:] &= ~first[:-1]  # a third row of a time repeats it
    event_times = np.array([*events.values()])
    time_from_events = np.abs(t[:, None] - event_times)
    distance = np.min(time_from_events, axis=1, initial=math.inf)
    is_at_event = distance < SAME
    return np.asarray(first & is_at_event)


def refuse_repeated(
    t: Floats, is_pair_start: NDArray[np.bool_], card: TableTrajectory, places: list[str], spacing: float
) -> None:
    """Require that rows with equal times are the two rows of an event.

    Parameters
    ----------
    t : (n,) s
        Times of the rows.
    is_pair_start : (n,) bool
        Which rows are the first of two rows at an event (see `find_pair_starts`).
    card : TableTrajectory
        Card of the file, for the message.
    places : list of str
        Line of each row, for the message.
    spacing : float
        Spacing of times of single precision, in the unit of the column; zero for times with all digits.

    Raises
    ------
    InputError
        A time is repeated without an event.
    """
    repeated_rows = np.flatnonzero((np.diff(t) == 0.0) & ~is_pair_start[:-1])
    if not repeated_rows.size:
        return
    k = int(repeated_rows[0])
    fault = f"{card.file}:{places[k + 1]}: time {t[k]:.9g} s repeats that of the row before"
    if spacing > 0.0:
        raise InputError(f"{fault}: column {card.time.column!r}: {coarse_message(spacing, card.time.unit)}")
    raise InputError(
        f"{fault}, with another state: if an event is there, declare it (events: {{NAME: {t[k]:.9g} s}}); if not, "
        "remove one of the two rows"
    )


def rounding(column: Floats) -> float:
    """Return one sigma of the rounding of a column's numbers, estimated from their digits; zero for full precision.

    A number rounded to a step has the standard deviation step / sqrt(12).
    """
    if np.all(column == column[0]):
        return 0.0
    largest = float(np.max(np.abs(column)))
    single_rounding = 0.0
    with np.errstate(over="ignore"):
        if np.all(column.astype(np.float32) == column):  # single precision, possibly with few digits as well
            spacing = float(np.spacing(np.float32(largest)))
            single_rounding = spacing / math.sqrt(12.0)
    for digits in range(-3, 10):
        power = 10.0**digits
        scaled_column = column * power
        if largest * power > 2.0**40:  # a double has hardly a digit more to round
            break
        remainder = np.abs(scaled_column - np.rint(scaled_column))
        is_whole = np.all(remainder < 1e-3)
        if np.ptp(scaled_column) >= 1.0 and is_whole:
            return max(single_rounding, 10.0**-digits / math.sqrt(12.0))
    return single_rounding
