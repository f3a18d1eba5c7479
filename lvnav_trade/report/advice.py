"""Recommended improvements: a filter that models the largest error, or a better sensor."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import shipped
from lvnav_trade.quantities.error_sources import fields_of
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.state_layout import EXTRAS, PARAMETERS, split_metric
from lvnav_trade.quantities.units import parse
from lvnav_trade.report.blocks import among, number, words
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.metric import where
from lvnav_trade.results.tables.read import Tables

# Unit of a datasheet for a field, by the SI unit in which resolved campaigns state it
_DATASHEET = {
    "rad/s**0.5": "deg/sqrt(h)",
    "rad/s**1.5": "deg/h/sqrt(h)",
    "rad/s": "deg/h",
    "rad*s/m": "deg/h/g",
    "m/s**1.5": "mg/sqrt(Hz)",
    "m/s**2.5": "mg/sqrt(h)",
    "m/s**2": "mg",
    "dimensionless": "ppm",
    "1/s**0.5": "ppm/sqrt(year)",
    "rad": "mrad",
}
_ANGLES = ("tilt", "heading")  # fields in degrees
_OF_A_STUDY = re.compile(r"_\d{3}(_|$)")  # in the name of a card
_MOST_FIELDS = 2
_FEW = 4  # sources that are all named
DOMINATING = 0.5  # share of the mean square from which on a source that the filter does not model is named


class MissingState(NamedTuple):
    """An error source that a filter does not model: its share of the mean square, the state that models it, and the
    shipped filter card with the same measurements and that state, empty where there is none.
    """

    source: str
    share: float
    state: str
    card: str


def advice(tables: Tables, row: Any) -> str:
    """Return what makes a design comply, from a row of the metric `improvements`: first a filter card that models the
    source, where the filter does not, then the improvement of the source. The row's remark where there is none.
    """
    case = {label: digest for digest, label in tables.labels.items()}[row.case]
    if not row.source:
        return f"{row.case}: {row.remark}."
    together, _, limits = row.remark.partition("; ") if row.remark.startswith("together") else ("", "", row.remark)
    many = "," in row.source
    scenario = scenario_of(tables, case)
    change = "" if many else _change(scenario, row.source, row.factor_ratio)
    stated = next(one for one in tables.campaign["requirements"] if str(one["name"]) == row.requirement)
    missing = None if many else missing_state(scenario, row.source, row.share_ratio)
    return say(
        "comply",
        case=row.case,
        model="" if missing is None else _filter(missing),
        source=_error(row.source),
        size=change or say("size", percent=f"{100.0 * row.factor_ratio:.3g}", together=bool(together)),
        share=f"{100.0 * row.share_ratio:.0f}",
        quantity=words(split_metric(str(stated["metric"]))[0]),
        event="" if stated.get("during") else words(where(stated)),
        is_one=not many,
        limits=limits,
    )


def ways_to_comply(improvements: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the metric `improvements` that name a change, those of designs that violate first.

    What linear covariance expects to be met as it is needs more runs, and no change.
    """
    rows = improvements[improvements.source != ""]
    return rows.sort_values("verdict", key=lambda verdicts: verdicts != "violated", kind="stable")


def _filter(missing: MissingState) -> str:
    """Say which filter to use for an error source that the present one does not model."""
    return say("model", card=missing.card, state=missing.state, source=_error(missing.source))


def unmodelled(tables: Tables, cases: Sequence[str]) -> tuple[str, list[MissingState]]:
    """Return the first required error in words, without requirements "velocity error at injection", and of these
    cases those whose filter lacks the state of one error source, each with the source's share of that error's mean
    square.

    The source is the one with the largest share of a case whose filter does not model it; none where it dominates in
    no case.
    """
    stated = (tables.campaign.get("requirements") or [{"metric": "velocity_error_3d"}])[0]
    quantity = split_metric(str(stated["metric"]))[0].removeprefix("normalised_")
    shares = {case: _shares(tables, case, quantity, str(stated.get("at") or "injection")) for case in cases}
    tops = [
        missing_state(scenario_of(tables, case), str(found.idxmax()), float(found.max()))
        for case, found in shares.items()
        if len(found)
    ]
    events = dict.fromkeys(str(found.name) for found in shares.values() if len(found))
    error = " at ".join([f"{words(quantity)} error", *(words(one) for one in events if len(events) == 1)])
    first = max((one for one in tops if one is not None), key=lambda one: one.share, default=None)
    if first is None:
        return error, []
    every = [
        missing_state(scenario_of(tables, case), first.source, float(found.get(first.source, 0.0)), 0.0)
        for case, found in shares.items()
    ]
    return error, [one for one in every if one is not None]


def _shares(tables: Tables, case: str, quantity: str, event: str) -> pd.Series:
    """Return each source's share of the mean square of an error by its name, at an event or else at the last one, which
    is the name of the series.
    """
    budget = METRICS["budget"](tables)
    rows = budget[(budget.case == tables.labels[case]) & (budget.metric == f"{quantity}_error")]
    at = event if event in set(rows.event) else rows.event.iloc[-1] if len(rows) else ""
    return rows[rows.event == at].set_index("source").share_ratio.rename(at)


def missing_state(
    scenario: Mapping[str, Any], source: str, share: float, least: float = DOMINATING
) -> MissingState | None:
    """Return the state that a scenario's filter lacks for an error source; None where it has one, where no state models
    the source, or where its share is below the least.
    """
    card = scenario.get("filter") or {}
    state = next((name for path, _ in fields_of(source) for name in _states(path)), "")
    modelled = {*card.get("extra_states", ()), *card.get("consider", ()), *card.get("as_noise", ())}
    if share < least or not state or state in modelled:
        return None
    wanted = {*modelled, state}
    known = (
        name
        for name, measured, states in _filter_cards()
        if measured == frozenset(card.get("measurements", ())) and wanted <= states
    )
    return MissingState(source, share, state, next(known, ""))


def _states(path: tuple[str, ...]) -> Iterator[str]:
    """Yield the extra state that models the error of a field of a scenario, where there is one."""
    part, name = path[-2] if len(path) > 1 else "", path[-1]
    if path[0] == "imu" and f"{part}_{name}" in PARAMETERS:
        yield f"{part}_{name}"
    elif path[0] in ("receiver", "atmosphere") and name in EXTRAS:
        yield name


@cache
def _filter_cards() -> list[tuple[str, frozenset[str], frozenset[str]]]:
    """Return name, measurements and extra states of the filter cards that come with the tool and have such states, but
    not of those of a publication, which have its number.
    """
    found = []
    folder = shipped("configs")
    for file in sorted((folder / "filters").glob("*.yaml")):
        if _OF_A_STUDY.search(file.stem):
            continue
        try:
            card = tree.plain(tree.read_mapping(file))
        except InputError:
            continue
        if card.get("extra_states"):
            states, measured = (frozenset(card.get(name) or ()) for name in ("extra_states", "measurements"))
            found.append((f"filters/{file.stem}", measured, states))
    return found


def _error(source: str) -> str:
    """Return an error source as a noun phrase; of several the largest ones, and the number of others."""
    names = source.split(", ")
    if len(names) > 1:
        return among(names, _FEW - 1 if len(names) > _FEW else _FEW)
    return f"{source.removesuffix('scale factor')}scale-factor error" if source.endswith("scale factor") else source


def _change(scenario: Mapping[str, Any], source: str, factor: float) -> str:
    """Return "from 1500 to 1010 ppm (1 sigma)" for the fields of a source; empty where one is no single number."""
    parts = []
    fields = fields_of(source)
    for path, power in fields:
        value = _at(scenario, path)
        size, _, si = str(value).partition(" ")
        if power != 1 or not isinstance(value, str) or not si:
            return ""
        if float(size) != 0.0:
            unit = "deg" if path[-1] in _ANGLES else _DATASHEET.get(si, si)
            shown = float(size) / parse(f"1 {unit}", si)
            name = f"{path[-1]} " if len(fields) > 1 else ""
            parts.append(f"{name}from {number(shown)} to {number(shown * factor)} {unit}")
    return f"{', '.join(parts)} (1 sigma)" if 0 < len(parts) <= _MOST_FIELDS else ""


def _at(data: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        if isinstance(data, list) and key.isdigit() and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, Mapping) else None
    return data
