"""Evidence: the models that a campaign uses, the checks of each, and the effects that it omits.

The list is `templates/models.toml`. A family of models may state the evidence of its members itself.
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
_FEW = 2  # up to this number of cases, each is named


@cache
def registry() -> dict[str, Any]:
    """Return the content of `templates/models.toml`: types of evidence, named conditions, an entry for each model."""
    document = tomllib.loads(source("models.toml"))
    document["model"] = [
        entry for item in document["model"] for entry in (_OF[item["of"]]() if "of" in item else [item])
    ]
    return document


def is_used(entry: Mapping[str, Any], scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as nested mappings and lists, uses the model of an entry."""
    named_conditions = registry()["where"][entry["where"]] if "where" in entry else {}
    return _hold(entry["used"], scenario) and _hold(named_conditions, scenario)


def _hold(conditions: Conditions, scenario: Mapping[str, Any]) -> bool:
    """Return whether at least one set of conditions is satisfied by a scenario."""
    sets = [conditions] if isinstance(conditions, Mapping) else conditions
    return any(
        all(_matches(list(at(scenario, path)), accepted) for path, accepted in condition_set.items())
        for condition_set in sets
    )


def at(data: Any, path: str) -> Iterator[Any]:
    """Yield the values at a dotted path of nested mappings and lists.

    Lists are yielded item by item; `*` matches every item or entry.
    """
    if not path:
        yield from data if isinstance(data, list) else [data]
        return
    key, _, remainder = path.partition(".")
    inside = data if isinstance(data, list) else data.values() if isinstance(data, Mapping) else ()
    if key == "*":
        for item in inside:
            yield from at(item, remainder)
    elif isinstance(data, Mapping) and key in data:
        yield from at(data[key], remainder)


def _matches(found: list[Any], wanted: Any) -> bool:
    if isinstance(wanted, bool):
        return any(map(_is_something, found)) is wanted
    return any(value in (wanted if isinstance(wanted, list) else [wanted]) for value in found)


def _is_something(value: Any) -> bool:
    """Return whether a value differs from None, False, empty, zero and zero with a unit."""
    if isinstance(value, str):
        first = value.partition(" ")[0]
        try:
            return float(first) != 0.0
        except ValueError:
            return bool(value)
    return bool(value)


def scenarios(tables: Tables) -> dict[str, Any]:
    """Return the scenario of each case by label, from the resolved campaign."""
    if not tables.campaign.get("base"):
        return {}
    return {tables.labels[case]: scenario_of(tables, case) for case in tables.levels}


@once
def evidence(tables: Tables) -> pd.DataFrame:
    """Return a row for each check of each model that the campaign uses.

    Returns
    -------
    pandas.DataFrame
        model : Name of the model.
        cases : "all", or the labels of the cases that use it.
        by, shown, test : Type, result and test of the check; empty for a model without checks.
        omits : Effects that the model omits.
    """
    cases = scenarios(tables)
    rows = []
    for entry in registry()["model"]:
        using = [label for label, scenario in cases.items() if is_used(entry, scenario)]
        if using:
            users = "all" if len(using) == len(cases) else "; ".join(using)
            checks = entry["checks"] or [{"by": "", "shown": "", "test": ""}]
            rows += [(entry["name"], users, len(using), *map(check.get, _CHECK), entry["omits"]) for check in checks]
    return pd.DataFrame(rows, columns=["model", "cases", "case_count", *_CHECK, "omits"])


_CHECK = ("by", "shown", "test")


def models(tables: Tables) -> list[Block]:
    """Return a row for each model that the campaign uses, with its checks and omissions."""
    frame = evidence(tables)
    if frame.empty:
        return []
    groups = frame.groupby("model", sort=False)
    by_model = groups.first().reset_index().assign(checks=[_in_words(rows) for _, rows in groups])
    by_model = by_model.assign(cases=[_few(row.cases, row.case_count) for row in by_model.itertuples()])
    if (by_model.cases == "all").all():
        by_model = by_model.drop(columns="cases")
    return [Text(note("models")), stated("models", by_model)]


def _in_words(checks: pd.DataFrame) -> str:
    """Return the checks of a model as sentences, one for each type of evidence."""
    by_sort = checks[checks.by != ""].groupby("by", sort=False).shown.agg("; ".join)
    return (
        " ".join(f"{sort.capitalize()}: {checks_of_sort}." for sort, checks_of_sort in by_sort.items())
        or "Nothing independent."
    )


def _few(cases: str, count: int) -> str:
    return cases if cases == "all" or count <= _FEW else f"{count} cases"
