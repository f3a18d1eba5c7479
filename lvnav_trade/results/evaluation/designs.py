"""Table of designs, one row each: levels of the axes in SI, errors at injection, requirements, cost."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluation.resources import resource_totals
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.requirements import confirmation
from lvnav_trade.results.requirements.improvements import lincov_verdicts
from lvnav_trade.results.requirements.limit_crossings import si_axes
from lvnav_trade.results.requirements.margins import severest_verdict
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    at_time,
    cache_result,
    final_event,
    flight_events,
    history_columns,
    pick,
)
from lvnav_trade.results.tables.dictionary import SUFFIXES, unit_at_end, unit_suffix
from lvnav_trade.results.tables.read import Tables

AXIS = "axis_"
# Columns of every design, with their meaning
MEANINGS = {
    "case": "digest of the resolved scenario and the seed, 12 hexadecimal digits",
    "design_number": "number of the design, from 0, if results have one row for each of many designs",
    "label": "levels of the axes as text",
    "run_count": "Monte Carlo runs, including failed ones",
    "failed_count": "failed runs",
    **{
        f"{name}_{unit_suffix(unit)}": f"true {name} error at injection (else the last event), 3-D, root mean square "
        "by linear covariance"
        for name, unit in NAVIGATION_UNITS.items()
    },
    **{
        f"{name}_formal_{unit_suffix(unit)}": f"the filter's own sigma of the {name} error there, 3-D"
        for name, unit in NAVIGATION_UNITS.items()
    },
    "nees_per_state_ratio": "expected NEES there over the number of its components: 1 for a consistent filter",
    "error_ratio": "largest error of a requirement over its limit: at most 1 where all are met",
    "limiting_requirement": "requirement with the largest error over its limit",
    "verdict": "worst verdict on the requirements",
    "reason": "reason why there are no numbers, or why linear covariance does not apply",
    "cost": "cost of the devices",
    "mass_kg": "mass of the devices",
    "power_w": "power of the devices",
    "volume_m3": "volume of the devices",
}
_LITRE = 1e-3


def designs(tables: Tables) -> pd.DataFrame:
    """Return one row per case, with numbers in the SI unit at the end of the column's name.

    Columns: those of `MEANINGS` that are known; ``axis_NAME`` (text) or ``axis_NAME_UNIT`` (number) of every axis; for
    every requirement the P-quantile of the error with the required probability P (``NAME_quantile_UNIT``), the
    probability of keeping the limit by linear covariance (``NAME_probability_ratio``), and the verdict
    (``NAME_verdict``).
    """
    if tables.has_designs:
        return _stored_designs(tables)
    frames = [
        pd.DataFrame({"case": list(tables.labels), "label": list(tables.labels.values())}),
        _axis_levels(tables),
        tables.cases[["run_count", "failed_count"]].reset_index(drop=True),
        pd.DataFrame([_navigation_errors(tables, case) for case in tables.labels], index=range(len(tables.labels))),
        *_requirement_results(tables),
    ]
    return _add_totals(tables, pd.concat(frames, axis=1))


def _stored_designs(tables: Tables) -> pd.DataFrame:
    """Return the designs of a design space, with JSON objects in texts as columns.

    All numbers and verdicts are by linear covariance, also those of designs that are simulated: results of their runs
    are in the other tables.
    """
    design_rows = tables.designs
    number_columns = [str(name) for name in design_rows.select_dtypes("number") if name != "design_number"]
    numeric_axes = set()
    for column in number_columns:
        if column.startswith(AXIS):
            name, _ = unit_at_end(column.removeprefix(AXIS))
            numeric_axes.add(name)
    frame = design_rows[["design_number", "case", "label"]].copy()
    levels = pd.DataFrame([json.loads(text) for text in design_rows["axes"]])
    for name in levels:
        axis = slug(str(name))
        if axis not in numeric_axes:
            frame[f"{AXIS}{axis}"] = levels[name].to_numpy()
    frame = pd.concat([frame, design_rows[number_columns]], axis=1)
    requirement_verdicts = [json.loads(text or "{}") for text in design_rows.verdicts]
    verdicts = pd.DataFrame(requirement_verdicts, index=design_rows.index)
    for requirement in tables.campaign.get("requirements") or ():
        name = requirement["name"]
        _, _, column = requirement_columns(requirement)
        frame[column] = verdicts[name].fillna("") if name in verdicts else ""
    return frame.assign(
        limiting_requirement=design_rows.limiting_requirement, verdict=design_rows.verdict, reason=design_rows.reason
    )


def slug(name: str) -> str:
    """Return a name for use in the name of a column: lower-case letters, digits and underscores."""
    return re.sub(r"\W+", "_", name).strip("_").lower()


def requirement_columns(requirement: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return the columns of a requirement: error, probability by linear covariance, verdict."""
    name = slug(str(requirement["name"]))
    unit = metric_of(str(requirement["metric"])).unit
    end = {"-": "ratio", "%": "percent"}.get(unit) or unit_suffix(unit)
    return f"{name}_quantile_{end}", f"{name}_probability_ratio", f"{name}_verdict"


def at_event(column: str, event: str) -> str:
    """Return the name of a column for another event: ``velocity_at_staging_m_per_s`` of ``velocity_m_per_s``."""
    name, end = split_suffix(column)
    return f"{name}_at_{slug(event)}{end}"


def split_suffix(column: str) -> tuple[str, str]:
    """Return a column's name without the suffix of its unit, and this suffix with its underscore."""
    ends = [f"_{end}" for end in SUFFIXES if column.endswith(f"_{end}")]
    without_suffix = column.removesuffix(max(ends, key=len, default=""))
    without_unit, _ = unit_at_end(column)
    name = min(without_suffix, without_unit, key=len)
    return name, column[len(name) :]


def meanings(frame: pd.DataFrame, requirements: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return column, unit and meaning of every column of `designs`."""
    column_meanings = dict(MEANINGS)
    for requirement in requirements:
        name = requirement["name"]
        error, probability, verdict = requirement_columns(requirement)
        column_meanings[error] = f"{name}: quantile of the error at the required probability"
        column_meanings[probability] = f"{name}: probability by linear covariance that the limit is kept"
        column_meanings[verdict] = f"{name}: verdict"
    rows = []
    for name in map(str, frame.columns):
        meaning = column_meanings.get(name) or _derived_meaning(name, column_meanings)
        rows.append({"column": name, "unit": unit_of(name), "meaning": meaning})
    return pd.DataFrame(rows, columns=["column", "unit", "meaning"])


def _derived_meaning(column: str, column_meanings: Mapping[str, str]) -> str:
    """Return the meaning of the column of an axis, or of another column at another event."""
    name, end = split_suffix(column)
    quantity, _, event = name.partition("_at_")
    if event and not column.startswith(AXIS) and f"{quantity}{end}" in column_meanings:
        return f"the same as {quantity}{end}, at the event {event}"
    return "level of the axis"


def unit_of(column: str) -> str:
    """Return the unit at the end of a column's name, in words; empty for text, counts and plain numbers."""
    _, end = split_suffix(column)
    suffix = end.removeprefix("_")
    if suffix in ("count", "number"):
        return ""
    _, unit = unit_at_end(column)
    return SUFFIXES.get(suffix) or unit


def _axis_levels(tables: Tables) -> pd.DataFrame:
    """Return the level of every axis in every case: numbers in SI, or labels."""
    numeric = {axis.name: axis for axis in si_axes(tables)}
    columns: dict[str, Any] = {}
    for name in next(iter(tables.levels.values()), {}):
        labels = [levels[name] for levels in tables.levels.values()]
        if name in numeric:
            axis = numeric[name]
            numbers = [axis.values.get(label, np.nan) for label in labels]
            columns[f"{AXIS}{slug(name)}_{unit_suffix(axis.unit)}"] = numbers
        else:
            columns[f"{AXIS}{slug(name)}"] = labels
    return pd.DataFrame(columns)


@cache_result
def _navigation_errors(tables: Tables, case: str) -> dict[str, float]:
    """Return the errors of a case at injection (or its last event), by column."""
    event = final_event(tables, case)
    if not event:
        return {}
    t_event = flight_events(tables, case).set_index("event").t_s[event]
    errors: dict[str, float] = {}
    for quantity in NAVIGATION:
        names = ("t_s", "lincov_true_si", "lincov_mean_si", "lincov_formal_si")
        t, true, mean, formal = history_columns(tables, case, quantity, "3d", *names)
        if t.size:
            nearest = int(np.argmin(np.abs(t - t_event)))
            suffix = unit_suffix(NAVIGATION_UNITS[quantity])
            rms = np.hypot(true[nearest], mean[nearest])
            errors[f"{quantity}_{suffix}"] = float(rms)
            errors[f"{quantity}_formal_{suffix}"] = float(formal[nearest])
    rows = pick(tables.consistency, case=case)
    if len(rows):
        row = at_time(rows, t_event)
        errors["nees_per_state_ratio"] = float(row.expected_nees_ratio) / float(row.nees_dof_count)
    return errors


def _requirement_results(tables: Tables) -> list[pd.DataFrame]:
    """Return the columns of every requirement, and those of all requirements together."""
    requirements = tables.campaign.get("requirements") or ()
    if not requirements or not tables.labels:
        return []
    labels = list(tables.labels.values())
    all_verdicts = confirmation.verdicts(tables).set_index(["requirement", "case"])
    all_lincov_verdicts = lincov_verdicts(tables).set_index(["requirement", "case"])
    columns: dict[str, Any] = {}
    ratios: dict[str, Any] = {}
    verdicts: dict[str, Any] = {}
    for requirement in requirements:
        name = requirement["name"]
        error, probability, verdict = requirement_columns(requirement)
        rows = all_verdicts.loc[name].reindex(labels)
        si = metric_of(str(requirement["metric"])).unit
        si_factors = [_si_factor(unit, si) for unit in rows.unit]
        columns[error] = rows.estimate.to_numpy(dtype=float) * si_factors
        expected_rows = all_lincov_verdicts.loc[name].reindex(labels)
        columns[probability] = expected_rows.expected_probability.to_numpy(dtype=float)
        columns[verdict] = rows.verdict.to_numpy()
        verdicts[name] = rows.verdict.to_numpy()
        ratios[name] = (rows.estimate / rows.limit).to_numpy(dtype=float)
    overall_columns = overall_verdicts(pd.DataFrame(ratios), pd.DataFrame(verdicts))
    return [pd.DataFrame(columns), overall_columns]


def overall_verdicts(ratios: pd.DataFrame, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Return `error_ratio`, `limiting_requirement` and `verdict` of designs.

    Parameters
    ----------
    ratios : pandas.DataFrame
        Error over limit, one row per design, one column per requirement; NaN if not known.
    verdicts : pandas.DataFrame
        Verdicts, with the same rows and columns.
    """
    is_complete = ratios.notna().all(axis=1)
    filled_ratios = ratios.fillna(-np.inf)  # idxmax refuses a row without numbers
    return pd.DataFrame(
        {
            "error_ratio": filled_ratios.max(axis=1).where(is_complete),
            "limiting_requirement": filled_ratios.idxmax(axis=1).where(is_complete, ""),
            "verdict": [severest_verdict(pd.Series(row)) for row in verdicts.itertuples(index=False)],
        }
    )


def _si_factor(unit: str, si: str) -> float:
    """Return the factor from a unit to SI; 1 for a number without unit.

    Parameters
    ----------
    unit : str
        Unit.
    si : str
        SI unit of the same dimension.
    """
    if unit in ("", "-", si) or si in ("-", "%"):
        return 1.0
    return parse(f"1 {unit}", si)


def _add_totals(tables: Tables, frame: pd.DataFrame) -> pd.DataFrame:
    """Return the designs with cost, mass, power and volume of their devices, as far as these are given."""
    totals = resource_totals(tables).set_index("case")
    for name in ("cost", "mass_kg", "power_w", "volume_l"):
        values = totals[name].reindex(frame.label).to_numpy(dtype=float)
        if not np.isfinite(values).any():
            continue
        if name == "volume_l":
            frame = frame.assign(volume_m3=_LITRE * values)
        else:
            frame = frame.assign(**{name: values})
    return frame
