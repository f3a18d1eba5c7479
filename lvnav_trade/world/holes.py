"""Gaps in the rows of a file: largest length allowed, and remarks on gaps that a spline bridges."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.errors import InputError
from lvnav_trade.records import Floats

_MANY = 6.0  # times the longer of the intervals beside it: more than that is a hole, less a change of rate


class Hole(NamedTuple):
    """A stretch from `start` to `end` (s) without rows, after row `row`, where the rows around are `usual` s apart."""

    row: int
    start: float
    end: float
    usual: float

    @property
    def length(self) -> float:
        """Length in s."""
        return self.end - self.start


def holes(t: Floats) -> list[Hole]:
    """Return the holes between rising times t (n,) in s."""
    interval = np.diff(t)
    beside = np.maximum(np.append(interval[1:], 0.0), np.append(0.0, interval[:-1]))
    found = np.flatnonzero((interval > _MANY * beside) & (beside > 0.0)).tolist()
    return [Hole(k, float(t[k]), float(t[k + 1]), float(beside[k])) for k in found]


def bridged(
    t: Floats, needed: float, longest: float, file: str, places: Sequence[str] = ()
) -> tuple[list[Hole], Hole | None]:
    """Return the holes that a spline through rows at rising t (n,) bridges, and the one before which the rows end.

    needed: time (s) up to which rows are wanted; longest: hole (s) that is bridged. A longer one ends the rows where
    nothing is needed behind it, and else is an InputError. places: where each row stands in the file.
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
    """Return in words which holes a spline bridges; nothing where there are none."""
    if not short:
        return []
    longest = max(short, key=lambda hole: hole.length)
    span = f"{longest.start:.6g} to {longest.end:.6g} s"
    if len(short) == 1:
        return [f"no data from {span}: a spline through the rows beside fills the hole"]
    return [f"{len(short)} holes without data, the longest from {span}: a spline through the rows beside fills them"]
