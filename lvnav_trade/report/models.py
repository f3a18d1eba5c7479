"""Evidence: the models that a campaign uses, what checks each and what it leaves out.

The list is `templates/models.toml`; members of a family that state their evidence themselves are read from there.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import pandas as pd

from lvnav_trade.campaign.definition.metric_names import of_sensors
from lvnav_trade.report.blocks import Block, Text, stated
from lvnav_trade.report.escape import note, source
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.tables.read import Tables, once

_OF = {"sensors": of_sensors}
Conditions = Mapping[str, Any] | Sequence[Mapping[str, Any]]
_FEW = 2  # cases that are named one by one


@cache
def registry() -> dict[str, Any]:
    """Return what `templates/models.toml` holds: sorts of evidence, named conditions, one entry for each model."""
    found = tomllib.loads(source("models.toml"))
    found["model"] = [entry for one in found["model"] for entry in (_OF[one["of"]]() if "of" in one else [one])]
    return found


def is_used(entry: Mapping[str, Any], scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as nested mappings and lists, uses the model of an entry."""
    where = registry()["where"][entry["where"]] if "where" in entry else {}
    return _hold(entry["used"], scenario) and _hold(where, scenario)


def _hold(conditions: Conditions, scenario: Mapping[str, Any]) -> bool:
    sets = [conditions] if isinstance(conditions, Mapping) else conditions
    return any(all(_matches(list(at(scenario, path)), wanted) for path, wanted in one.items()) for one in sets)


def at(data: Any, path: str) -> Iterator[Any]:
    """Yield what stands at a dotted path, the items of a list one by one; `*` is every item or entry."""
    if not path:
        yield from data if isinstance(data, list) else [data]
        return
    key, _, rest = path.partition(".")
    inside = data if isinstance(data, list) else data.values() if isinstance(data, Mapping) else ()
    if key == "*":
        for item in inside:
            yield from at(item, rest)
    elif isinstance(data, Mapping) and key in data:
        yield from at(data[key], rest)


def _matches(found: list[Any], wanted: Any) -> bool:
    if isinstance(wanted, bool):
        return any(map(_is_something, found)) is wanted
    return any(value in (wanted if isinstance(wanted, list) else [wanted]) for value in found)


def _is_something(value: Any) -> bool:
    """Return whether a value is none of nothing, false, empty, zero and zero with a unit."""
    if isinstance(value, str):
        first = value.partition(" ")[0]
        try:
            return float(first) != 0.0
        except ValueError:
            return bool(value)
    return bool(value)


def scenarios(tables: Tables) -> dict[str, Any]:
    """Return the scenario of each case by its label, as the resolved campaign states it; none where it states none."""
    if not tables.campaign.get("base"):
        return {}
    return {tables.labels[case]: scenario_of(tables, case) for case in tables.levels}


@once
def evidence(tables: Tables) -> pd.DataFrame:
    """Return a row for each check of each model that the campaign uses.

    Columns: model; cases that use it ("all", or their labels); by, shown, test: the check, empty where there is none;
    omits: what the model leaves out.
    """
    cases = scenarios(tables)
    rows = []
    for entry in registry()["model"]:
        using = [label for label, scenario in cases.items() if is_used(entry, scenario)]
        if using:
            named = "all" if len(using) == len(cases) else "; ".join(using)
            checks = entry["checks"] or [{"by": "", "shown": "", "test": ""}]
            rows += [(entry["name"], named, len(using), *map(check.get, _CHECK), entry["omits"]) for check in checks]
    return pd.DataFrame(rows, columns=["model", "cases", "case_count", *_CHECK, "omits"])


_CHECK = ("by", "shown", "test")


def models(tables: Tables) -> list[Block]:
    """Return one row for each model that the campaign uses: what checks it and what it leaves out."""
    frame = evidence(tables)
    if frame.empty:
        return []
    groups = frame.groupby("model", sort=False)
    shown = groups.first().reset_index().assign(checks=[_in_words(rows) for _, rows in groups])
    shown = shown.assign(cases=[_few(row.cases, row.case_count) for row in shown.itertuples()])
    if (shown.cases == "all").all():
        shown = shown.drop(columns="cases")
    return [Text(note("models")), stated("models", shown)]


def _in_words(checks: pd.DataFrame) -> str:
    """Return the checks of a model as sentences, one for each sort."""
    by_sort = checks[checks.by != ""].groupby("by", sort=False).shown.agg("; ".join)
    return " ".join(f"{sort.capitalize()}: {shown}." for sort, shown in by_sort.items()) or "Nothing independent."


def _few(cases: str, count: int) -> str:
    return cases if cases == "all" or count <= _FEW else f"{count} cases"
