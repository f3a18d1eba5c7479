"""Cases of the terms of a statement."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple


class Reading(NamedTuple):
    """Levels of the axes that no term names, and the number of each term's case."""

    levels: dict[str, str]
    cases: dict[str, int]


def matching(known: Sequence[Mapping[str, str]], levels: Mapping[str, str]) -> list[int]:
    """Return the numbers of the cases (level of every axis of each) that have all the levels."""
    numbers = []
    for number, case_levels in enumerate(known):
        if all(case_levels.get(axis) == level for axis, level in levels.items()):
            numbers.append(number)
    return numbers


def readings(known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]]) -> list[Reading]:
    """Return the cases of each term for all levels, in turn, of the axes without a name in any term.

    Parameters
    ----------
    known : (n_case,) sequence of mapping
        Level of every axis of each case.
    wanted : mapping
        Levels that each term names, by term.

    Returns
    -------
    list of Reading
        Choices with exactly one case for each term.

    Notes
    -----
    Axes that vary together (design zip) need not all be named. Of the subsets of the free axes that give the largest
    number of readings, the smallest is used. If axes vary one at a time, it has every free axis.
    """
    named_axes = {axis for levels in wanted.values() for axis in levels}
    all_axes = known[0] if known else ()
    free_axes = [axis for axis in all_axes if axis not in named_axes]
    candidates = []
    for n in range(len(free_axes) + 1):
        for axes in combinations(free_axes, n):
            candidates.append(_readings_along(known, wanted, axes))
    return max(candidates, key=len)  # the first of equal length, with the fewest axes


def _readings_along(
    known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]], axes: Sequence[str]
) -> list[Reading]:
    """Return the readings for all levels of some axes, where each term has exactly one case."""
    complete_readings = []
    choices = dict.fromkeys(tuple(levels[axis] for axis in axes) for levels in known)
    for choice in choices:
        levels = dict(zip(axes, choice, strict=True))
        numbers = {}
        for name, term_levels in wanted.items():
            numbers[name] = matching(known, {**term_levels, **levels})
        if all(len(matches) == 1 for matches in numbers.values()):
            case_numbers = {name: matches[0] for name, matches in numbers.items()}
            complete_readings.append(Reading(levels, case_numbers))
    return complete_readings
