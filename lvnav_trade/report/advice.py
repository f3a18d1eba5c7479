"""Recommended improvements: a filter that models the largest error, or a better sensor."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import pandas as pd

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.quantities.error_sources import fields_of
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.state_layout import EXTRAS, PARAMETERS, split_metric
from lvnav_trade.quantities.units import parse
from lvnav_trade.report.blocks import join_names, number, words
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.resources import scenario_of
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.tables.read import Tables

# Unit of a datasheet for a field, by the SI unit of the field in resolved campaigns
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
_FEW = 4  # up to this number of sources, each is named
DOMINATING = 0.5  # smallest share of the mean square at which an unmodelled source is reported


class MissingState(NamedTuple):
    """An error source that a filter does not model.

    source : Name of the error source.
    share : Its share of the mean square of the error, 0 to 1.
    state : Filter state that models the source.
    card : Shipped filter card with the same measurements and that state; empty if there is no such card.
    """

    source: str
    share: float
    state: str
    card: str


def advice(tables: Tables, row: Any) -> str:
    """Return the change that makes a design comply, as text.

    The text names a filter card that models the error source, if the present filter does not, and then the improvement
    of the source itself.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    row : namedtuple
        Row of the metric `improvements`. Without a source, the text is its remark.
    """
    if not row.source:
        return f"{row.case}: {row.remark}."
    digests = {label: digest for digest, label in tables.labels.items()}
    scenario = scenario_of(tables, digests[row.case])
    requirements = {str(requirement["name"]): requirement for requirement in tables.campaign["requirements"]}
    requirement = requirements[row.requirement]
    joint_remark = ""
    limits = row.remark
    if row.remark.startswith("together"):
        joint_remark, _, limits = row.remark.partition("; ")
    is_joint = "," in row.source
    change, model = "", ""
    if not is_joint:
        change = _change(scenario, row.source, row.factor_ratio)
        missing = missing_state(scenario, row.source, row.share_ratio)
        model = "" if missing is None else _filter(missing)
    if not change:
        change = say("size", percent=f"{100.0 * row.factor_ratio:.3g}", together=bool(joint_remark))
    return say(
        "comply",
        case=row.case,
        model=model,
        source=_error(row.source, _dispersions(tables)),
        size=change,
        share=f"{100.0 * row.share_ratio:.0f}",
        quantity=words(split_metric(str(requirement["metric"]))[0]),
        event="" if requirement.get("during") else words(event_or_phase(requirement)),
        is_one=not is_joint,
        limits=limits,
    )


def ways_to_comply(improvements: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the metric `improvements` that name a change, violating designs first.

    A design that linear covariance expects to comply unchanged needs more runs, not a change; it is omitted.
    """
    rows = improvements[improvements.source != ""]
    return rows.sort_values("verdict", key=lambda verdicts: verdicts != "violated", kind="stable")


def _filter(missing: MissingState) -> str:
    """Say which filter to use for an error source that the present one does not model."""
    return say("model", card=missing.card, state=missing.state, source=_error(missing.source, frozenset()))


def missing_states(tables: Tables, cases: Sequence[str]) -> tuple[str, list[MissingState]]:
    """Return the designs whose filter does not model the dominating error source.

    The error is that of the first requirement, or the velocity error at injection without requirements. The source is
    the unmodelled one with the largest share in any case.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    cases : sequence of str
        Digests of the cases.

    Returns
    -------
    error : str
        The error in words.
    missing : list of MissingState
        The cases whose filter lacks the state, each with the source's share; empty if the source dominates in no case.
    """
    requirements = tables.campaign.get("requirements") or [{"metric": "velocity_error_3d"}]
    first_requirement = requirements[0]
    metric_quantity, _ = split_metric(str(first_requirement["metric"]))
    quantity = metric_quantity.removeprefix("normalised_")
    event = str(first_requirement.get("at") or "injection")
    shares = {case: _shares(tables, case, quantity, event) for case in cases}

    events = dict.fromkeys(str(case_shares.name) for case_shares in shares.values() if len(case_shares))
    error = f"{words(quantity)} error"
    if len(events) == 1:
        error += f" at {words(next(iter(events)))}"

    largest = None
    for case, case_shares in shares.items():
        if not len(case_shares):
            continue
        source = str(case_shares.idxmax())
        scenario = scenario_of(tables, case)
        missing = missing_state(scenario, source, float(case_shares.max()))
        if missing is not None and (largest is None or missing.share > largest.share):
            largest = missing
    if largest is None:
        return error, []

    all_missing = []
    for case, case_shares in shares.items():
        share = float(case_shares.get(largest.source, 0.0))
        scenario = scenario_of(tables, case)
        missing = missing_state(scenario, largest.source, share, smallest_share=0.0)
        if missing is not None:
            all_missing.append(missing)
    return error, all_missing


def _shares(tables: Tables, case: str, quantity: str, event: str) -> pd.Series:
    """Return each source's share of the mean square of an error, by source.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity : str
        Quantity of the error, such as "velocity".
    event : str
        Event; the last event of the budget is used if the budget lacks it.

    Returns
    -------
    pandas.Series
        Shares (0 to 1) by source. The series is named after the event.
    """
    budget = METRICS["budget"](tables)
    is_metric = budget.metric == f"{quantity}_error"
    rows = budget[(budget.case == tables.labels[case]) & is_metric]
    if event not in set(rows.event):
        event = rows.event.iloc[-1] if len(rows) else ""
    shares = rows[rows.event == event].set_index("source").share_ratio
    return shares.rename(event)


def missing_state(
    scenario: Mapping[str, Any], source: str, share: float, smallest_share: float = DOMINATING
) -> MissingState | None:
    """Return the state that the filter of a scenario lacks for an error source.

    Parameters
    ----------
    scenario : mapping
        The scenario as nested mappings.
    source : str
        Error source.
    share : float
        Share of the source in the mean square, 0 to 1.
    smallest_share : float
        Smallest share that is reported.

    Returns
    -------
    MissingState or None
        None if the filter models the source, if no state models it, or if the share is below `smallest_share`.
    """
    card = scenario.get("filter") or {}
    state = _first_state(source)
    modelled_states = {*card.get("extra_states", ()), *card.get("consider", ()), *card.get("as_noise", ())}
    if share < smallest_share or not state or state in modelled_states:
        return None
    required_states = {*modelled_states, state}
    measurements = frozenset(card.get("measurements", ()))
    for name, card_measurements, states in _filter_cards():
        if card_measurements == measurements and required_states <= states:
            return MissingState(source, share, state, name)
    return MissingState(source, share, state, "")


def _first_state(source: str) -> str:
    """Return the extra state that models an error source, of its first field that has one; empty if no state does."""
    for path, _ in fields_of(source):
        state = _extra_state(path)
        if state:
            return state
    return ""


def _extra_state(path: tuple[str, ...]) -> str:
    """Return the extra state that models the error in a field of a scenario; empty if no state does."""
    sensor = path[-2] if len(path) > 1 else ""
    name = path[-1]
    if path[0] == "imu" and f"{sensor}_{name}" in PARAMETERS:
        return f"{sensor}_{name}"
    if path[0] in ("receiver", "atmosphere") and name in EXTRAS:
        return name
    return ""


@cache
def _filter_cards() -> list[tuple[str, frozenset[str], frozenset[str]]]:
    """Return name, measurements and extra states of the shipped filter cards that have extra states.

    Cards of a publication (recognised by their number) are omitted.
    """
    cards = []
    folder = tool_folder("configs")
    for file in sorted((folder / "filters").glob("*.yaml")):
        if _OF_A_STUDY.search(file.stem):
            continue
        try:
            card = tree.plain_data(tree.read_mapping(file))
        except InputError:
            continue
        states = frozenset(card.get("extra_states") or ())
        measurements = frozenset(card.get("measurements") or ())
        if states:
            cards.append((f"filters/{file.stem}", measurements, states))
    return cards


def _error(source: str, dispersions: frozenset[str]) -> str:
    """Return an error source as a noun phrase, or several sources as a list.

    Of many sources only the first are listed, followed by the number of the others.

    dispersions : names of the sources that are dispersions of the vehicle, such as thrust
    """
    names = source.split(", ")
    if len(names) > 1:
        nouns = [f"{name} dispersion" if name in dispersions else name for name in names]
        if len(nouns) > _FEW:
            return join_names(nouns, _FEW - 1)
        return f"{', '.join(nouns[:-1])} and {nouns[-1]}"
    if source in dispersions:
        return f"{source} dispersion"
    if source.endswith("scale factor"):
        return f"{source.removesuffix('scale factor')}scale-factor error"
    return source


def _dispersions(tables: Tables) -> frozenset[str]:
    """Return the names of the error sources that are dispersions of a guided vehicle."""
    rows = tables.injection_covariances
    return frozenset(rows.source[rows.source_group == "vehicle"])


def _change(scenario: Mapping[str, Any], source: str, factor: float) -> str:
    """Return the required change of a source as text: "from 1500 to 1010 ppm (1 sigma)".

    Parameters
    ----------
    scenario : mapping
        The scenario as nested mappings.
    source : str
        Error source.
    factor : float
        Required sigma divided by the present sigma.

    Returns
    -------
    str
        Empty if a field of the source is not a single number with a unit, or if there are too many fields.
    """
    field_texts = []
    fields = fields_of(source)
    for path, power in fields:
        value = _value_at(scenario, path)
        size, _, si_unit = str(value).partition(" ")
        if power != 1 or not isinstance(value, str) or not si_unit:
            return ""
        if float(size) == 0.0:
            continue
        if path[-1] in _ANGLES:
            unit = "deg"
        else:
            unit = _DATASHEET.get(si_unit, si_unit)
        display_value = float(size) / parse(f"1 {unit}", si_unit)
        name = f"{path[-1]} " if len(fields) > 1 else ""
        field_texts.append(f"{name}from {number(display_value)} to {number(display_value * factor)} {unit}")
    if 0 < len(field_texts) <= _MOST_FIELDS:
        return f"{', '.join(field_texts)} (1 sigma)"
    return ""


def _value_at(data: Any, path: tuple[str, ...]) -> Any:
    """Return the value at a path of keys and list positions; None if the path does not exist."""
    for key in path:
        if isinstance(data, list) and key.isdigit() and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, Mapping) else None
    return data
