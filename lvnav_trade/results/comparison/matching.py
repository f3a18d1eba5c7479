"""Matching of the cases of two result sets, and the reasons why two result sets are not comparable."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.errors import InputError, Mistake, refuse_all
from lvnav_trade.results.statistics.select import SAME_TIME, flight_events, pick
from lvnav_trade.results.tables.read import Tables

# Largest distance (m) between equal trajectories: rounding of different compilers
_SAME_PLACE = 1.0
_EARTH = 6378137.0


class Pair(NamedTuple):
    """A pair of cases to compare."""

    base: str  # digest in the base
    candidate: str  # digest in the candidate
    label: str


def match(base: Tables, candidate: Tables, mapping: Mapping[str, str] | None = None) -> list[Pair]:
    """Return the pairs of cases to compare, in the order of the base.

    Cases with equal labels form a pair. A single case on each side forms a pair with any labels.

    Parameters
    ----------
    base, candidate : Tables
        The two result sets.
    mapping : mapping of str to str, optional
        Name in the candidate by name in the base, of a case (label or digest) or of a level of an axis
        (``{"tactical_fog": "tactical_fog_worse"}``).

    Returns
    -------
    list of Pair
        Pairs of cases.

    Raises
    ------
    InputError
        One line per reason: another seed, no common case, an unknown name in `mapping`, another trajectory or other
        events.
    """
    seeds = base.campaign.get("seed"), candidate.campaign.get("seed")
    if seeds[0] != seeds[1]:
        raise InputError(
            f"does not compare: other seed ({base.folder} drew with {seeds[0]}, {candidate.folder} with {seeds[1]}); "
            "runs belong together only on the same draws"
        )
    pairs = _pairs(base, candidate, dict(mapping or {}))
    reasons = (_another_flight(base, candidate, pair) for pair in pairs)
    refuse_all([Mistake(f"does not compare: {why}") for why in reasons if why])
    return pairs


def left_out(base: Tables, candidate: Tables, pairs: Sequence[Pair]) -> list[str]:
    """Return a note on the cases that have no partner."""
    sides = ((base, {pair.base for pair in pairs}, candidate), (candidate, {pair.candidate for pair in pairs}, base))
    return [
        f"Not compared, because {other.folder} has no such case: {'; '.join(alone)}."
        for tables, kept, other in sides
        if (alone := [label for case, label in tables.labels.items() if case not in kept])
    ]


def _pairs(base: Tables, candidate: Tables, mapping: dict[str, str]) -> list[Pair]:
    digests = {label: case for case, label in candidate.labels.items()}
    _check(base, mapping)
    _check(candidate, mapping.values())
    found = []
    for case, levels in base.levels.items():
        label = base.labels[case]
        mapped = mapping.get(label) or mapping.get(case)
        renamed = {axis: mapping.get(level, level) for axis, level in levels.items()}
        if mapped or renamed == levels:
            wanted = mapped or label
            partner = digests.get(wanted) or (wanted if wanted in candidate.labels else None)
        else:
            partner = next((other for other, of_other in candidate.levels.items() if of_other == renamed), None)
        if partner is not None:
            found.append((case, partner))
    if not found and len(base.labels) == len(candidate.labels) == 1:
        found = list(zip(base.labels, candidate.labels, strict=True))
    if not found:
        raise InputError(
            f"does not compare: no common case; {base.folder} has {_named(base)}, {candidate.folder} has "
            f"{_named(candidate)}; --map BASE:CANDIDATE says which belong together"
        )
    labels = [(base.labels[case], candidate.labels[partner]) for case, partner in found]
    shown = [label if other == label else f"{label} → {other}" for label, other in labels]
    return [Pair(*pair, label) for pair, label in zip(found, shown, strict=True)]


def _check(tables: Tables, names: Iterable[str]) -> None:
    levels = [level for of_case in tables.levels.values() for _, level in sorted(of_case.items())]
    words = list(dict.fromkeys([*tables.labels, *tables.labels.values(), *levels]))
    for name in names:
        if name not in words:
            near = difflib.get_close_matches(name, words, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else f"; it has {_named(tables)}"
            raise InputError(f"--map: {tables.folder} has no case or level {name!r}{hint}")


def _named(tables: Tables) -> str:
    return "; ".join(tables.labels.values()) or "no case"


def _another_flight(base: Tables, candidate: Tables, pair: Pair) -> str:
    """Return the difference between the trajectories of a pair, in words; empty if they are equal."""
    sides = ((base, pair.base), (candidate, pair.candidate))
    first, second = (tables.cases.set_index("case").epoch[case] for tables, case in sides)
    if first != second:
        return f"{pair.label}: other trajectory (lift-off at {first} and at {second})"
    times, others = (flight_events(tables, case).set_index("event").t_s.to_dict() for tables, case in sides)
    if set(times) != set(others):
        return f"{pair.label}: other events (only one of the two has {', '.join(sorted(set(times) ^ set(others)))})"
    for name, t in times.items():
        if abs(t - others[name]) > SAME_TIME:
            return f"{pair.label}: other events ({name} at {t:g} s and at {others[name]:g} s)"
    if not all((tables.folder / "reference.parquet").exists() for tables, _ in sides):
        return ""
    apart = _distance(*(pick(tables.reference, case=case) for tables, case in sides))
    return f"{pair.label}: other trajectory ({apart:.3g} m apart)" if apart > _SAME_PLACE else ""


def _distance(first: pd.DataFrame, second: pd.DataFrame) -> float:
    """Return the largest distance (m) between two trajectories at their common times."""
    both = first.merge(second, on="t_s", suffixes=("", "_other"))
    if both.empty:
        return 0.0
    north = (both.latitude_rad - both.latitude_rad_other) * _EARTH
    east = np.angle(np.exp(1j * (both.longitude_rad - both.longitude_rad_other))) * _EARTH * np.cos(both.latitude_rad)
    return float(np.sqrt(north**2 + east**2 + (both.altitude_m - both.altitude_m_other) ** 2).max())
