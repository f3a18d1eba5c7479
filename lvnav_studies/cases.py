"""Cases of the terms of a statement."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple


class Reading(NamedTuple):
    """Levels of the axes that no term names, and the number of each term's case."""

    levels: dict[str, str]
    cases: dict[str, int]


def matching_cases(case_levels: Sequence[Mapping[str, str]], levels: Mapping[str, str]) -> list[int]:
    """Return the numbers of the cases (level of every axis of each) that have all the levels."""
    numbers = []
    for number, levels_of_case in enumerate(case_levels):
        if all(levels_of_case.get(axis) == level for axis, level in levels.items()):
            numbers.append(number)
    return numbers


def readings(case_levels: Sequence[Mapping[str, str]], term_levels: Mapping[str, Mapping[str, str]]) -> list[Reading]:
    """Return the cases of each term for all levels, in turn, of the axes without a name in any term.

    Parameters
    ----------
    case_levels : (n_case,) sequence of mapping
        Level of every axis of each case.
    term_levels : mapping
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
    named_axes = {axis for levels in term_levels.values() for axis in levels}
    all_axes = case_levels[0] if case_levels else ()
    free_axes = [axis for axis in all_axes if axis not in named_axes]
    candidates = []
    for n in range(len(free_axes) + 1):
        for axes in combinations(free_axes, n):
            candidates.append(_readings_along(case_levels, term_levels, axes))
    return max(candidates, key=len)  # the first of equal length, with the fewest axes


def _readings_along(
    case_levels: Sequence[Mapping[str, str]], term_levels: Mapping[str, Mapping[str, str]], axes: Sequence[str]
) -> list[Reading]:
    """Return the readings for all levels of some axes, where each term has exactly one case."""
    complete_readings = []
    choices = dict.fromkeys(tuple(levels[axis] for axis in axes) for levels in case_levels)
    for choice in choices:
        levels = dict(zip(axes, choice, strict=True))
        numbers = {}
        for name, levels_of_term in term_levels.items():
            numbers[name] = matching_cases(case_levels, {**levels_of_term, **levels})
        if all(len(matches) == 1 for matches in numbers.values()):
            case_numbers = {name: matches[0] for name, matches in numbers.items()}
            complete_readings.append(Reading(levels, case_numbers))
    return complete_readings
