"""The cases that the terms of a statement stand for."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple


class Reading(NamedTuple):
    """Levels of the axes that no term names, and the number of each term's case."""

    levels: dict[str, str]
    cases: dict[str, int]


def matching(known: Sequence[Mapping[str, str]], levels: Mapping[str, str]) -> list[int]:
    """Return the numbers of the cases (level of every axis of each) that have all the levels."""
    return [k for k, one in enumerate(known) if all(one.get(axis) == level for axis, level in levels.items())]


def readings(known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]]) -> list[Reading]:
    """Return the cases of each term for all levels, in turn, of the axes that no term names.

    known: level of every axis of each case; wanted: levels that each term names. Axes that vary together (design zip)
    need not all be named: the fewest are read that leave each term one case, of those that read the most cases (one
    axis varied at a time: every axis).
    """
    named = {axis for levels in wanted.values() for axis in levels}
    free = [axis for axis in (known[0] if known else ()) if axis not in named]
    sizes = range(len(free) + 1)
    return max((_read_by(known, wanted, axes) for n in sizes for axes in combinations(free, n)), key=len)


def _read_by(
    known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]], axes: Sequence[str]
) -> list[Reading]:
    found = []
    for choice in dict.fromkeys(tuple(levels[axis] for axis in axes) for levels in known):
        levels = dict(zip(axes, choice, strict=True))
        cases = {name: matching(known, {**one, **levels}) for name, one in wanted.items()}
        if all(len(one) == 1 for one in cases.values()):
            found.append(Reading(levels, {name: one[0] for name, one in cases.items()}))
    return found
