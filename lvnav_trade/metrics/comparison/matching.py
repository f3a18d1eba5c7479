"""Which cases of two results belong together, and in words why two results do not compare."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.errors import InputError, Mistake, refuse_all
from lvnav_trade.metrics.basics.select import SAME_TIME, flight_events, pick
from lvnav_trade.store.read import Tables

# Metres by which two flights that are the same may differ: roundings of another compiler, not another flight.
_SAME_PLACE = 1.0
_EARTH = 6378137.0


class Pair(NamedTuple):
    """A case of the base and the case of the candidate that it is compared with: digests, and a label for people."""

    base: str
    candidate: str
    label: str


def match(base: Tables, candidate: Tables, mapping: Mapping[str, str] | None = None) -> list[Pair]:
    """Return the cases that belong together, in the base's order.

    Cases of equal labels belong together; a single case on each side does whatever it is called. `mapping` leads from
    the base's name to the candidate's: of a case (its label or digest), or of a level that an axis has
    (``{"tactical_fog": "tactical_fog_worse"}``).

    Raises
    ------
    InputError
        One line per reason: another seed, no case in common, a name in `mapping` that nothing has, another trajectory
        or other events.
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
    """Say which cases have no partner."""
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
    for case, own in base.levels.items():
        label = base.labels[case]
        stated = mapping.get(label) or mapping.get(case)
        named = {axis: mapping.get(level, level) for axis, level in own.items()}
        if stated or named == own:
            wanted = stated or label
            partner = digests.get(wanted) or (wanted if wanted in candidate.labels else None)
        else:
            partner = next((other for other, held in candidate.levels.items() if held == named), None)
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
    levels = [level for held in tables.levels.values() for _, level in sorted(held.items())]
    words = list(dict.fromkeys([*tables.labels, *tables.labels.values(), *levels]))
    for name in names:
        if name not in words:
            near = difflib.get_close_matches(name, words, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else f"; it has {_named(tables)}"
            raise InputError(f"--map: {tables.folder} has no case or level {name!r}{hint}")


def _named(tables: Tables) -> str:
    return "; ".join(tables.labels.values()) or "no case"


def _another_flight(base: Tables, candidate: Tables, pair: Pair) -> str:
    """Say what is different about the flights of a pair; nothing where they are the same."""
    sides = ((base, pair.base), (candidate, pair.candidate))
    first, second = (tables.cases.set_index("case").epoch[case] for tables, case in sides)
    if first != second:
        return f"{pair.label}: other trajectory (lift-off at {first} and at {second})"
    own, other = (flight_events(tables, case).set_index("event").t_s.to_dict() for tables, case in sides)
    if set(own) != set(other):
        return f"{pair.label}: other events (only one of the two has {', '.join(sorted(set(own) ^ set(other)))})"
    for name, t in own.items():
        if abs(t - other[name]) > SAME_TIME:
            return f"{pair.label}: other events ({name} at {t:g} s and at {other[name]:g} s)"
    if not all((tables.folder / "reference.parquet").exists() for tables, _ in sides):
        return ""
    apart = _distance(*(pick(tables.reference, case=case) for tables, case in sides))
    return f"{pair.label}: other trajectory ({apart:.3g} m apart)" if apart > _SAME_PLACE else ""


def _distance(first: pd.DataFrame, second: pd.DataFrame) -> float:
    """Return the largest distance (m) of two flights at the times that both hold."""
    both = first.merge(second, on="t_s", suffixes=("", "_other"))
    if both.empty:
        return 0.0
    north = (both.latitude_rad - both.latitude_rad_other) * _EARTH
    east = np.angle(np.exp(1j * (both.longitude_rad - both.longitude_rad_other))) * _EARTH * np.cos(both.latitude_rad)
    return float(np.sqrt(north**2 + east**2 + (both.altitude_m - both.altitude_m_other) ** 2).max())
