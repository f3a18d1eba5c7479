"""Pseudoranges and range rates in a log: one row for each satellite and epoch, of one signal."""

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.errors import InputError, quoted
from lvnav_trade.records import Bools, Floats
from lvnav_trade.units import Card
from lvnav_trade.world.user_file.data_file import column_names, read_columns, read_texts, refuse_first
from lvnav_trade.world.user_file.imu_log import time_column

_NAME = re.compile(r"([A-Za-z])\s*([0-9]{1,3})")
_COLUMNS = ("pseudorange_m", "range_rate_m_s")
_FEWEST = 4
_SAME = 1e-3  # s between rows of one epoch
_NEAREST, _FARTHEST, _FASTEST = 1e5, 1e9, 3e4  # m, m, m/s with both clocks


class RangesFile(Card):
    """The file of pseudoranges and range rates, for filters that take them."""

    file: str
    delimiter: str = Field(",", min_length=1, max_length=1)


class Ranges(NamedTuple):
    """Rows of ranges: t (n,) s from the receiver's first row; satellites (n,) names by `satellite_name`; values (n, 2)
    pseudorange (m) and range rate (m/s), as measured, NaN where there is none; notes: on rows without them.
    """

    t: Floats
    satellites: tuple[str, ...]
    values: Floats
    file: str = "ranges"
    notes: tuple[str, ...] = ()


def satellite_name(text: str) -> str:
    """Return the name of a satellite as RINEX writes it: G05 of `G 5`, `G5`, `g05`; other names as they are."""
    found = _NAME.fullmatch(text.strip())
    return f"{found[1].upper()}{int(found[2]):02d}" if found else text.strip()


def read_ranges(card: RangesFile, folder: Path, zero: float) -> Ranges:
    """Return the ranges of a file, times from `zero` s of it on; InputError names file, row and fault: a number that no
    receiver measures, a row without a satellite, two rows of a satellite at one time.
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
    """InputError for the first row of a satellite whose time is that of another row of it."""
    _, number = np.unique(names, return_inverse=True)
    order = np.lexsort((t, number))
    again = (np.diff(number[order]) == 0) & (np.diff(t[order]) < _SAME)
    pairs = [sorted((int(order[k]), int(order[k + 1]))) for k in np.flatnonzero(again)]
    for first, second in sorted(pairs, key=lambda pair: pair[1])[:1]:
        raise InputError(
            f"{file}:{places[second]}: {quoted(names[second])} at {t[second]:.9g} s again, as in {places[first]}: keep "
            "the rows of one signal"
        )
