"""Gaps between the rows of a data file: largest length allowed, and remarks on gaps that a spline bridges."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats

_MANY = 6.0  # times the longer neighbouring interval: above it an interval is a gap, below it a change of rate


class Hole(NamedTuple):
    """A gap between two rows of a file.

    row : Index of the last row before the gap.
    start, end : s. Times of the rows before and after it.
    usual : s. Longer of the intervals around it.
    """

    row: int
    start: float
    end: float
    usual: float

    @property
    def length(self) -> float:
        """Length in s."""
        return self.end - self.start


def holes(t: Floats) -> list[Hole]:
    """Return the gaps between rising times t (n,) in s."""
    interval = np.diff(t)
    neighbour = np.maximum(np.append(interval[1:], 0.0), np.append(0.0, interval[:-1]))
    gaps = np.flatnonzero((interval > _MANY * neighbour) & (neighbour > 0.0)).tolist()
    return [Hole(k, float(t[k]), float(t[k + 1]), float(neighbour[k])) for k in gaps]


def bridged(
    t: Floats, needed: float, longest: float, file: str, places: Sequence[str] = ()
) -> tuple[list[Hole], Hole | None]:
    """Return the gaps that a spline bridges, and the gap at which the data end.

    Parameters
    ----------
    t : (n,) s
        Rising times of the rows.
    needed : float
        Time (s) up to which data are required. At a longer gap after it the data end.
    longest : float
        Longest gap (s) that a spline bridges.
    file : str
        Name of the file for messages.
    places : sequence of str
        Line of each row, for messages.

    Raises
    ------
    InputError
        A gap longer than `longest` begins before `needed`.
    """
    short: list[Hole] = []
    for hole in holes(t):
        if hole.length <= longest:
            short.append(hole)
        elif hole.start >= needed:
            return short, hole
        else:
            line = f":{places[hole.row + 1]}" if places else ""
            raise InputError(
                f"{file}{line}: no data between {hole.start:g} s and {hole.end:g} s, where the rows around are "
                f"{hole.usual:.3g} s apart; at most {longest:g} s are bridged"
            )
    return short, None


def described(short: Sequence[Hole]) -> list[str]:
    """Return the remark on the gaps that a spline bridges; an empty list without gaps."""
    if not short:
        return []
    longest = max(short, key=lambda hole: hole.length)
    span = f"{longest.start:.6g} to {longest.end:.6g} s"
    if len(short) == 1:
        return [f"no data from {span}: a spline through the rows beside fills the hole"]
    return [f"{len(short)} holes without data, the longest from {span}: a spline through the rows beside fills them"]
