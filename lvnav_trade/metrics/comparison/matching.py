"""Which cases of two results belong together, and in words why two results do not compare."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.metrics.basics.select import flight_events
from lvnav_trade.store import Tables

_SAME_TIME = 1e-6
"""Seconds by which an event may differ between two flights that are the same."""
_SAME_PLACE = 1.0
"""Metres by which they may differ: roundings of another compiler, not another flight."""
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
    mistakes = [
        Mistake(f"does not compare: {why}") for pair in pairs if (why := _another_flight(base, candidate, pair))
    ]
    if mistakes:
        raise InputError(records=mistakes)
    return pairs


def left_out(base: Tables, candidate: Tables, pairs: Sequence[Pair]) -> list[str]:
    """Say which cases have no partner."""
    notes = []
    for tables, kept, other in (
        (base, {pair.base for pair in pairs}, candidate),
        (candidate, {pair.candidate for pair in pairs}, base),
    ):
        alone = [label for case, label in tables.labels.items() if case not in kept]
        if alone:
            notes.append(f"Not compared, because {other.folder} has no such case: {'; '.join(alone)}.")
    return notes


def _pairs(base: Tables, candidate: Tables, mapping: dict[str, str]) -> list[Pair]:
    digests = {label: case for case, label in candidate.labels.items()}
    levels = _levels(candidate)
    _check(base, candidate, mapping)
    found = []
    for case, own in _levels(base).items():
        label = base.labels[case]
        stated = mapping.get(label) or mapping.get(case)
        named = frozenset((axis, mapping.get(level, level)) for axis, level in own)
        if stated or named == own:
            wanted = stated or label
            partner = digests.get(wanted) or (wanted if wanted in candidate.labels else None)
        else:
            partner = next((other for other, held in levels.items() if held == named), None)
        if partner is not None:
            other = candidate.labels[partner]
            found.append(Pair(case, partner, label if other == label else f"{label} → {other}"))
    if not found and len(base.labels) == len(candidate.labels) == 1:
        (case, label), (partner, other) = *base.labels.items(), *candidate.labels.items()
        return [Pair(case, partner, f"{label} → {other}")]
    if not found:
        raise InputError(
            f"does not compare: no common case; {base.folder} has {_named(base)}, {candidate.folder} has "
            f"{_named(candidate)}; --map BASE:CANDIDATE says which belong together"
        )
    return found


def _levels(tables: Tables) -> dict[str, frozenset[tuple[str, str]]]:
    """Return the level of every axis, case by case, in the order of the plan."""
    cases = tables.cases
    return {case: frozenset(json.loads(text).items()) for case, text in zip(cases["case"], cases["axes"], strict=True)}


def _check(base: Tables, candidate: Tables, mapping: dict[str, str]) -> None:
    """Refuse names that nothing has."""
    for name, (tables, words) in [
        *((name, (base, _words(base))) for name in mapping),
        *((name, (candidate, _words(candidate))) for name in mapping.values()),
    ]:
        if name not in words:
            near = difflib.get_close_matches(name, words, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else f"; it has {_named(tables)}"
            raise InputError(f"--map: {tables.folder} has no case or level {name!r}{hint}")


def _words(tables: Tables) -> list[str]:
    levels = [level for held in _levels(tables).values() for _, level in sorted(held)]
    return list(dict.fromkeys([*tables.labels, *tables.labels.values(), *levels]))


def _named(tables: Tables) -> str:
    return "; ".join(tables.labels.values()) or "no case"


def _another_flight(base: Tables, candidate: Tables, pair: Pair) -> str:
    """Say what is different about the flights of a pair; nothing where they are the same."""
    epochs = [tables.cases.set_index("case").epoch[case] for tables, case in _sides(base, candidate, pair)]
    if epochs[0] != epochs[1]:
        return f"{pair.label}: other trajectory (lift-off at {epochs[0]} and at {epochs[1]})"
    events = [
        flight_events(tables, case).set_index("event").t_s.to_dict() for tables, case in _sides(base, candidate, pair)
    ]
    if set(events[0]) != set(events[1]):
        only = sorted(set(events[0]) ^ set(events[1]))
        return f"{pair.label}: other events (only one of the two has {', '.join(only)})"
    for name, t in events[0].items():
        if abs(t - events[1][name]) > _SAME_TIME:
            return f"{pair.label}: other events ({name} at {t:g} s and at {events[1][name]:g} s)"
    apart = _distance(*(_flown(tables, case) for tables, case in _sides(base, candidate, pair)))
    return f"{pair.label}: other trajectory ({apart:.3g} m apart)" if apart > _SAME_PLACE else ""


def _sides(base: Tables, candidate: Tables, pair: Pair) -> list[tuple[Tables, str]]:
    return [(base, pair.base), (candidate, pair.candidate)]


def _flown(tables: Tables, case: str) -> pd.DataFrame | None:
    """Return where a case flies; None where that is not kept."""
    if not (tables.folder / "reference.parquet").exists():
        return None
    rows = tables.reference
    return rows[rows.case == case]


def _distance(first: pd.DataFrame | None, second: pd.DataFrame | None) -> float:
    """Return the largest distance (m) of two flights at the times that both hold."""
    if first is None or second is None:
        return 0.0
    both = first.merge(second, on="t_s", suffixes=("", "_other"))
    if both.empty:
        return 0.0
    north = (both.latitude_rad - both.latitude_rad_other) * _EARTH
    turned = np.angle(np.exp(1j * (both.longitude_rad - both.longitude_rad_other)))
    east = turned * _EARTH * np.cos(both.latitude_rad)
    up = both.altitude_m - both.altitude_m_other
    return float(np.sqrt(north**2 + east**2 + up**2).max())
