"""Names of cases as a report shows them: names of cards where they differ by cards."""

import re
from collections.abc import Mapping
from typing import Any

from lvnav_trade.store.read import Tables

_OF_A_FILE = re.compile(r"[a-z0-9][a-z0-9_.-]*")  # label of a level that the file of its card gave
_LONGEST = 80  # characters of a card's name; a longer one is no heading
SEPARATOR = " · "


def case_names(tables: Tables) -> dict[str, str]:
    """Return a name for each case (digest), in the order of the plan; two cases never have the same.

    A level of an axis is named by the name of its card where every card of the axis has one of its own, by axis and
    label otherwise, such as ``update_rate=1 Hz``; axes whose level is the same in all cases are left out. The label
    itself stays where that is no name, and of results of many designs, which are called by their numbers.
    """
    if tables.has_designs:
        return dict(tables.labels)
    names = list(next(iter(tables.levels.values()), {}))
    stated = dict(zip(names, tables.campaign.get("axes") or (), strict=False))
    shown = {name: _level_names(stated[name]) for name in names if name in stated}
    varied = [name for name in names if len({levels[name] for levels in tables.levels.values()}) > 1]
    found = {}
    for case, levels in tables.levels.items():
        parts = [shown.get(name, {}).get(levels[name], f"{name}={levels[name]}") for name in varied]
        named = any(levels[name] in shown.get(name, {}) for name in varied)
        found[case] = SEPARATOR.join(parts) if named else tables.labels[case]
    twice = [name for name in found.values() if list(found.values()).count(name) > 1]
    return {case: tables.labels[case] if name in twice else name for case, name in found.items()}


def _level_names(axis: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of an axis's cards by label; nothing where the levels are no cards, or the user named them."""
    labels, values = list(axis.get("labels") or ()), list(axis.get("values") or ())
    cards = [value.get("name") if isinstance(value, Mapping) else None for value in values]
    usable = [isinstance(name, str) and 0 < len(name) <= _LONGEST and SEPARATOR not in name for name in cards]
    from_files = all(_OF_A_FILE.fullmatch(str(label)) for label in labels)
    if not labels or not all(usable) or not from_files or len(set(cards)) < len(cards):
        return {}
    return {str(label): str(name) for label, name in zip(labels, cards, strict=True)}


def named(tables: Tables) -> Tables:
    """Return the same results with the names of cases in place of their labels."""
    names = case_names(tables)
    if names == tables.labels:
        return tables
    return tables.with_frames(cases=tables.cases.assign(label=tables.cases.case.map(names)))
