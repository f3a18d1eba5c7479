"""Recorded pseudoranges and range rates: a row for each satellite and epoch, of a single signal."""

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.data_file import column_names, read_columns, read_texts, refuse_first
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Card
from lvnav_trade.simulation.recorded.imu_log import time_column

_NAME = re.compile(r"([A-Za-z])\s*([0-9]{1,3})")
_COLUMNS = ("pseudorange_m", "range_rate_m_s")
_FEWEST = 4
_SAME = 1e-3  # s between rows of one epoch
_NEAREST, _FARTHEST, _FASTEST = 1e5, 1e9, 3e4  # m, m, m/s; limits with the errors of both clocks


class RangesFile(Card):
    """The file of pseudoranges and range rates, for filters that measure them."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)


class Ranges(NamedTuple):
    """Recorded ranges, n rows.

    t : (n,) s. Time since the first row of the receiver.
    satellites : (n,). Names as from `satellite_name`.
    values : (n, 2) m, m/s. Measured pseudorange and range rate; NaN if missing.
    file : Name of the file.
    notes : Remarks on rows with missing values.
    """

    t: Floats
    satellites: tuple[str, ...]
    values: Floats
    file: str = "ranges"
    notes: tuple[str, ...] = ()


def satellite_name(text: str) -> str:
    """Return the RINEX name of a satellite, such as G05 for `G 5`, `G5`, `g05`; other names are unchanged."""
    match = _NAME.fullmatch(text.strip())
    return f"{match[1].upper()}{int(match[2]):02d}" if match else text.strip()


def read_ranges(card: RangesFile, folder: Path, zero: float) -> Ranges:
    """Return the ranges of a file.

    Parameters
    ----------
    card : RangesFile
    folder : Path
        Folder to which the file name is relative.
    zero : float
        Time (s) of the file from which the result counts.

    Raises
    ------
    InputError
        A number that no receiver measures, a row without a satellite, two rows of a satellite at the same time. The
        message names file, row and error.
    """
    file = os.fspath(folder / card.file)
    time, scale = time_column(file, column_names(file, card.delimiter))
    table, places = read_columns(file, [time, *_COLUMNS], card.delimiter, _FEWEST, "a log", blanks=_COLUMNS)
    texts = read_texts(file, "satellite", card.delimiter)
    refuse_first(np.array([not text.strip() for text in texts]), file, places, lambda k: "satellite is empty")
    t, names = table[:, 0] * scale, tuple(map(satellite_name, texts))
    _refuse_second(t, names, file, places)
    size, rate = table[:, 1], table[:, 2]
    missing = [~(size > 0.0), ~np.isfinite(rate) | (rate == 0.0)]
    why = ("is empty, zero or below it", "is empty or zero")
    for name, gone, reason in zip(_COLUMNS, missing, why, strict=True):
        if gone.all():
            raise InputError(f"{file}:{places[0]}: {name} {reason}, in all {gone.size} rows")
    refuse_first(
        ~missing[0] & ((size < _NEAREST) | (size > _FARTHEST)),
        file,
        places,
        lambda k: f"pseudorange_m is {size[k]:.9g}; is it in m?",
    )
    refuse_first(
        ~missing[1] & (np.abs(rate) > _FASTEST),
        file,
        places,
        lambda k: f"range_rate_m_s is {rate[k]:.9g}; is it in m/s?",
    )
    values = np.where(np.column_stack(missing), np.nan, table[:, 1:])
    notes = tuple(
        f"{name} {reason} in {np.count_nonzero(gone)} of {gone.size} rows: left out ({_named(file, places, gone)})"
        for name, gone, reason in zip(_COLUMNS, missing, why, strict=True)
        if gone.any()
    )
    return Ranges(t - zero, names, values, file, notes)


def _named(file: str, places: list[str], gone: Bools) -> str:
    which = np.flatnonzero(gone)
    return f"{os.path.basename(file)}:{', '.join(places[k] for k in which[:5])}" + (", ..." if which.size > 5 else "")


def _refuse_second(t: Floats, names: tuple[str, ...], file: str, places: list[str]) -> None:
    """Raise InputError for the first two rows of a satellite at the same time."""
    _, number = np.unique(names, return_inverse=True)
    order = np.lexsort((t, number))
    repeated = (np.diff(number[order]) == 0) & (np.diff(t[order]) < _SAME)
    pairs = [sorted((int(order[k]), int(order[k + 1]))) for k in np.flatnonzero(repeated)]
    for first, second in sorted(pairs, key=lambda pair: pair[1])[:1]:
        raise InputError(
            f"{file}:{places[second]}: {quoted(names[second])} at {t[second]:.9g} s again, as in {places[first]}: keep "
            "the rows of one signal"
        )
