"""Evidence: the models that a campaign uses, the checks of each, and the effects that it omits.

The list is `templates/models.toml`. A family of models may give the evidence of its members.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import pandas as pd

from lvnav_trade.campaign.definition.metric_names import sensor_entries
from lvnav_trade.report.blocks import Block, Text, formatted_table
from lvnav_trade.report.escape import note, source
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.tables.read import Tables, cache_result

_OF = {"sensors": sensor_entries}
Conditions = Mapping[str, Any] | Sequence[Mapping[str, Any]]
_FEW = 2  # up to this number of cases, each is named
_CHECK = ("by", "shown", "test")  # columns of a check


@cache
def registry() -> dict[str, Any]:
    """Return the content of `templates/models.toml`: types of evidence, named conditions, an entry for each model."""
    document = tomllib.loads(source("models.toml"))
    entries: list[Any] = []
    for item in document["model"]:
        if "of" in item:
            entries += _OF[item["of"]]()
        else:
            entries.append(item)
    document["model"] = entries
    return document


def is_used(entry: Mapping[str, Any], scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as nested mappings and lists, uses the model of an entry."""
    named_conditions = registry()["where"][entry["where"]] if "where" in entry else {}
    return _is_met(entry["used"], scenario) and _is_met(named_conditions, scenario)


def _is_met(conditions: Conditions, scenario: Mapping[str, Any]) -> bool:
    """Return whether at least one set of conditions is satisfied by a scenario."""
    sets = [conditions] if isinstance(conditions, Mapping) else conditions
    for condition_set in sets:
        if all(_matches(list(values_at(scenario, path)), condition) for path, condition in condition_set.items()):
            return True
    return False


def values_at(data: Any, path: str) -> Iterator[Any]:
    """Yield the values at a dotted path of nested mappings and lists.

    Lists are yielded item by item; `*` matches every item or entry.
    """
    if not path:
        yield from data if isinstance(data, list) else [data]
        return
    key, _, remainder = path.partition(".")
    if key == "*":
        items: Iterable[Any] = ()
        if isinstance(data, list):
            items = data
        elif isinstance(data, Mapping):
            items = data.values()
        for item in items:
            yield from values_at(item, remainder)
    elif isinstance(data, Mapping) and key in data:
        yield from values_at(data[key], remainder)


def _matches(values: list[Any], condition: Any) -> bool:
    """Return whether any value is accepted: one of some values, or (True, False) whether something is set."""
    if isinstance(condition, bool):
        return any(map(_is_something, values)) is condition
    accepted_values = condition if isinstance(condition, list) else [condition]
    return any(value in accepted_values for value in values)


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


@cache_result
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
        labels = [label for label, scenario in cases.items() if is_used(entry, scenario)]
        if not labels:
            continue
        users = "all" if len(labels) == len(cases) else "; ".join(labels)
        for check in entry["checks"] or [{"by": "", "shown": "", "test": ""}]:
            check_texts = map(check.get, _CHECK)
            rows.append((entry["name"], users, len(labels), *check_texts, entry["omits"]))
    return pd.DataFrame(rows, columns=["model", "cases", "case_count", *_CHECK, "omits"])


def models(tables: Tables) -> list[Block]:
    """Return a row for each model that the campaign uses, with its checks and omissions."""
    frame = evidence(tables)
    if frame.empty:
        return []
    groups = frame.groupby("model", sort=False)
    rows = groups.first().reset_index()
    rows = rows.assign(
        checks=[_check_sentences(checks) for _, checks in groups],
        cases=[_case_text(row.cases, row.case_count) for row in rows.itertuples()],
    )
    if (rows.cases == "all").all():
        rows = rows.drop(columns="cases")
    return [Text(note("models")), formatted_table("models", rows)]


def _check_sentences(checks: pd.DataFrame) -> str:
    """Return the checks of a model as sentences, one for each type of evidence."""
    groups = checks[checks.by != ""].groupby("by", sort=False)
    sentences = []
    for evidence_type, rows in groups:
        results = "; ".join(rows.shown)
        sentences.append(f"{evidence_type.capitalize()}: {results}.")
    return " ".join(sentences) or "Nothing independent."


def _case_text(cases: str, count: int) -> str:
    if cases == "all" or count <= _FEW:
        return cases
    return f"{count} cases"
