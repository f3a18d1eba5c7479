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
from lvnav_trade.results.requirements.improvements import expected
from lvnav_trade.results.requirements.limit_crossings import si_axes
from lvnav_trade.results.requirements.margins import worst
from lvnav_trade.results.statistics.select import NAVIGATION, final_event, flight_events, history_columns, once, pick
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
        return _of_many(tables)
    frame = pd.DataFrame({"case": list(tables.labels), "label": list(tables.labels.values())})
    frame = pd.concat([frame, _axes(tables), _runs(tables), _navigation(tables), *_requirements(tables)], axis=1)
    return _with_totals(tables, frame)


def _of_many(tables: Tables) -> pd.DataFrame:
    """Return the designs of a design space, with JSON objects in texts as columns.

    All numbers and verdicts are by linear covariance, also those of designs that are simulated: results of their runs
    are in the other tables.
    """
    stored = tables.designs
    numbers = [str(name) for name in stored.select_dtypes("number") if name != "design_number"]
    levels = pd.DataFrame([json.loads(text) for text in stored["axes"]])
    numeric = {name.removeprefix(AXIS) for name in numbers if name.startswith(AXIS)}
    texts = {name: slug(str(name)) for name in levels}
    texts = {name: text for name, text in texts.items() if not any(_is_of(text, column) for column in numeric)}
    frame = stored[["design_number", "case", "label"]].copy()
    for name, text in texts.items():
        frame[f"{AXIS}{text}"] = levels[name].to_numpy()
    frame = pd.concat([frame, stored[numbers]], axis=1)
    words = pd.DataFrame([json.loads(text or "{}") for text in stored.verdicts], index=stored.index)
    for requirement in tables.campaign.get("requirements") or ():
        name = requirement["name"]
        frame[requirement_columns(requirement)[2]] = words[name].fillna("") if name in words else ""
    return frame.assign(limiting_requirement=stored.limiting_requirement, verdict=stored.verdict, reason=stored.reason)


def _is_of(name: str, column: str) -> bool:
    """Whether a column (without ``axis_``) is the numeric axis with a name, followed by its unit."""
    return unit_at_end(column)[0] == name


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
    name, end = name_and_end(column)
    return f"{name}_at_{slug(event)}{end}"


def name_and_end(column: str) -> tuple[str, str]:
    """Return a column's name without the suffix of its unit, and this suffix with its underscore."""
    ends = [f"_{end}" for end in SUFFIXES if column.endswith(f"_{end}")]
    name = min(column.removesuffix(max(ends, key=len, default="")), unit_at_end(column)[0], key=len)
    return name, column[len(name) :]


def meanings(frame: pd.DataFrame, requirements: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return column, unit and meaning of every column of `designs`."""
    known = dict(MEANINGS)
    for requirement in requirements:
        name = requirement["name"]
        error, probability, verdict = requirement_columns(requirement)
        known[error] = f"{name}: error that the fraction of flights asked for stays below"
        known[probability] = f"{name}: probability by linear covariance that the limit is kept"
        known[verdict] = f"{name}: verdict"
    rows = [(name, unit_of(name), known.get(name) or _meaning(name, known)) for name in map(str, frame.columns)]
    return pd.DataFrame(rows, columns=["column", "unit", "meaning"])


def _meaning(column: str, known: Mapping[str, str]) -> str:
    """Return the meaning of the column of an axis, or of a known column at another event."""
    name, end = name_and_end(column)
    of, _, event = name.partition("_at_")
    is_elsewhere = bool(event) and not column.startswith(AXIS) and f"{of}{end}" in known
    return f"the same as {of}{end}, at the event {event}" if is_elsewhere else "level of the axis"


def unit_of(column: str) -> str:
    """Return the unit at the end of a column's name, in words; empty for text, counts and plain numbers."""
    end = name_and_end(column)[1].removeprefix("_")
    return "" if end in ("count", "number") else SUFFIXES.get(end) or unit_at_end(column)[1]


def _axes(tables: Tables) -> pd.DataFrame:
    numeric = {axis.name: axis for axis in si_axes(tables)}
    columns: dict[str, Any] = {}
    for name in next(iter(tables.levels.values()), {}):
        levels = [of_case[name] for of_case in tables.levels.values()]
        if name in numeric:
            axis = numeric[name]
            numbers = [axis.values.get(level, np.nan) for level in levels]
            columns[f"{AXIS}{slug(name)}_{unit_suffix(axis.unit)}"] = numbers
        else:
            columns[f"{AXIS}{slug(name)}"] = levels
    return pd.DataFrame(columns)


def _runs(tables: Tables) -> pd.DataFrame:
    return tables.cases[["run_count", "failed_count"]].reset_index(drop=True)


def _navigation(tables: Tables) -> pd.DataFrame:
    """Return the errors of every case at injection (or its last event)."""
    return pd.DataFrame([_errors_of(tables, case) for case in tables.labels], index=range(len(tables.labels)))


@once
def _errors_of(tables: Tables, case: str) -> dict[str, float]:
    event = final_event(tables, case)
    times = flight_events(tables, case).set_index("event").t_s
    found: dict[str, float] = {}
    for quantity in NAVIGATION:
        names = ("t_s", "lincov_true_si", "lincov_mean_si", "lincov_formal_si")
        t, true, mean, formal = history_columns(tables, case, quantity, "3d", *names)
        if event and t.size:
            at = int(np.argmin(np.abs(t - times[event])))
            end = unit_suffix(NAVIGATION_UNITS[quantity])
            found[f"{quantity}_{end}"] = float(np.hypot(true[at], mean[at]))
            found[f"{quantity}_formal_{end}"] = float(formal[at])
    rows = pick(tables.consistency, case=case)
    if event and len(rows):
        row = rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - times[event])))]
        found["nees_per_state_ratio"] = float(row.expected_nees_ratio) / float(row.nees_dof_count)
    return found


def _requirements(tables: Tables) -> list[pd.DataFrame]:
    """Return the columns of every requirement, and those of all requirements together."""
    requirements = tables.campaign.get("requirements") or ()
    if not requirements or not tables.labels:
        return []
    by_name = ["requirement", "case"]
    verdicts, by_covariance = (rows.set_index(by_name) for rows in (confirmation.verdicts(tables), expected(tables)))
    columns: dict[str, Any] = {}
    ratios: dict[str, Any] = {}
    words: dict[str, Any] = {}
    for requirement in requirements:
        name = requirement["name"]
        error, probability, verdict = requirement_columns(requirement)
        rows = verdicts.loc[name].reindex(list(tables.labels.values()))
        si = metric_of(str(requirement["metric"])).unit
        columns[error] = rows.estimate.to_numpy(dtype=float) * [_in_si(unit, si) for unit in rows.unit]
        expectation = by_covariance.loc[name].reindex(rows.index)
        columns[probability] = expectation.expected_probability.to_numpy(dtype=float)
        columns[verdict] = words[name] = rows.verdict.to_numpy()
        ratios[name] = (rows.estimate / rows.limit).to_numpy(dtype=float)
    return [pd.DataFrame(columns), together(pd.DataFrame(ratios), pd.DataFrame(words))]


def together(ratios: pd.DataFrame, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Return `error_ratio`, `limiting_requirement` and `verdict` of designs.

    ratios : error over limit, one row per design, one column per requirement; NaN if not known
    verdicts : verdicts, with the same rows and columns
    """
    known = ratios.notna().all(axis=1)
    whole = ratios.fillna(-np.inf)
    return pd.DataFrame(
        {
            "error_ratio": whole.max(axis=1).where(known),
            "limiting_requirement": whole.idxmax(axis=1).where(known, ""),
            "verdict": [worst(pd.Series(row)) for row in verdicts.itertuples(index=False)],
        }
    )


def _in_si(unit: str, si: str) -> float:
    """Return the factor from a unit to SI; 1 for a number without unit."""
    return 1.0 if unit in ("", "-", si) or si in ("-", "%") else parse(f"1 {unit}", si)


def _with_totals(tables: Tables, frame: pd.DataFrame) -> pd.DataFrame:
    """Return the designs with cost, mass, power and volume of their devices, as far as these are given."""
    by_case = resource_totals(tables).set_index("case")
    for name in ("cost", "mass_kg", "power_w", "volume_l"):
        values = by_case[name].reindex(frame.label).to_numpy(dtype=float)
        if np.isfinite(values).any():
            frame = frame.assign(**({"volume_m3": _LITRE * values} if name == "volume_l" else {name: values}))
    return frame
