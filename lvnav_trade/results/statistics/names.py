"""Names of cases for reports: names of cards if the cases differ by cards."""

import re
from collections.abc import Mapping
from typing import Any

from lvnav_trade.results.tables.read import Tables

_OF_A_FILE = re.compile(r"[a-z0-9][a-z0-9_.-]*")  # label of a level that is the file name of its card
_LONGEST = 80  # characters; a longer name of a card is not used as a heading
SEPARATOR = " · "


def case_names(tables: Tables) -> dict[str, str]:
    """Return a unique name for each case, by digest, in the order of the plan.

    A level of an axis has the name of its card if all cards of the axis have different names, otherwise axis and label,
    such as ``update_rate=1 Hz``. Axes with the same level in all cases are omitted. If no level has the name of a card,
    and in a design space, the label of the case is its name.
    """
    if tables.has_designs:
        return dict(tables.labels)
    names = list(next(iter(tables.levels.values()), {}))
    stated = dict(zip(names, tables.campaign.get("axes") or (), strict=False))
    shown = {name: _level_names(stated[name]) for name in names if name in stated}
    varied = [name for name in names if len({levels[name] for levels in tables.levels.values()}) > 1]
    by_case = {}
    for case, levels in tables.levels.items():
        parts = [shown.get(name, {}).get(levels[name], f"{name}={levels[name]}") for name in varied]
        has_card = any(levels[name] in shown.get(name, {}) for name in varied)
        by_case[case] = SEPARATOR.join(parts) if has_card else tables.labels[case]
    twice = [name for name in by_case.values() if list(by_case.values()).count(name) > 1]
    return {case: tables.labels[case] if name in twice else name for case, name in by_case.items()}


def _level_names(axis: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of an axis's cards by label; empty if the levels are not cards, or have labels of the user."""
    labels, values = list(axis.get("labels") or ()), list(axis.get("values") or ())
    cards = [value.get("name") if isinstance(value, Mapping) else None for value in values]
    usable = [isinstance(name, str) and 0 < len(name) <= _LONGEST and SEPARATOR not in name for name in cards]
    from_files = all(_OF_A_FILE.fullmatch(str(label)) for label in labels)
    if not labels or not all(usable) or not from_files or len(set(cards)) < len(cards):
        return {}
    return {str(label): str(name) for label, name in zip(labels, cards, strict=True)}


def named(tables: Tables) -> Tables:
    """Return the results with the names of the cases as their labels."""
    names = case_names(tables)
    if names == tables.labels:
        return tables
    return tables.with_frames(cases=tables.cases.assign(label=tables.cases.case.map(names)))
