"""Which requirements are met, at the confidence asked for, and how many more runs would decide the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade import units
from lvnav_trade.metrics.intervals import runs_needed, success_bounds
from lvnav_trade.metrics.select import split_metric
from lvnav_trade.store import Tables, load
from lvnav_trade.store.schema import error_column

COLUMNS = [
    "requirement", "case", "verdict", "estimate", "limit", "probability", "confidence", "runs", "failures",
    "runs_to_decide",
]  # fmt: skip


def verdicts(results: Path | str | Tables) -> pd.DataFrame:
    """Return the verdict on every requirement in every case.

    "met": the lower bound on the probability of success reaches the probability asked for; "violated": the upper bound
    stays below it; "undecided" otherwise. The bounds are exact binomial (Clopper and Pearson), each one-sided at the
    confidence asked for. A failed run is a failure. estimate: the error that the stated fraction of runs stays below,
    limit: the bound on it, both with their unit; runs_to_decide: further runs, all good, after which it would be met.
    """
    tables = load(results)
    rows = [
        {"requirement": requirement["name"], "case": label, **_verdict(tables, case, requirement)}
        for requirement in tables.campaign.get("requirements") or ()
        for case, label in tables.labels.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def judge(runs: int, failures: int, probability: float, confidence: float) -> tuple[str, int]:
    """Return the verdict and how many further runs, all of them good, would show that the requirement is met."""
    low, high = success_bounds(runs, failures, confidence)
    if runs and low >= probability:
        return "met", 0
    if high < probability:
        return "violated", 0
    return "undecided", max(1, runs_needed(failures, probability, confidence) - runs)


def _verdict(tables: Tables, case: str, requirement: dict[str, Any]) -> dict[str, Any]:
    probability, confidence = float(requirement["probability"]), float(requirement.get("confidence", 0.9))
    quantity, axis = split_metric(requirement["metric"])
    at = requirement.get("at", "injection")
    outputs = tables.outputs
    known = outputs[(outputs.case == case) & (outputs.quantity == quantity) & (outputs.axis == axis)]
    if known.empty:
        error, bound, unit, factor = np.empty(0), 0.0, "", 1.0
    else:
        row = known.iloc[0]
        unit, factor, bound = row.label_unit, row.label_factor_ratio, bound_of(requirement["below"], row.unit)
        error = _errors(tables, case, at, error_column(quantity, axis, row.unit))
    failures = int((error >= bound).sum())
    verdict, more = judge(len(error), failures, probability, confidence)
    return {
        "verdict": verdict,
        "estimate": told(_quantile(error, probability) * factor, unit),
        "limit": told(bound * factor, unit),
        "probability": probability,
        "confidence": confidence,
        "runs": len(error),
        "failures": failures,
        "runs_to_decide": more,
    }


def _errors(tables: Tables, case: str, event: str, column: str) -> np.ndarray[Any, Any]:
    """Return |error| of every run at the event, SI; infinite where the run failed."""
    runs = tables.runs
    chosen = runs[(runs.case == case) & (runs.event == event)]
    if column not in runs.columns:
        return np.empty(0)
    size = np.abs(chosen[column].to_numpy(dtype=float))
    return np.where((chosen.failure.to_numpy() != "") | ~np.isfinite(size), np.inf, size)


def bound_of(below: Any, unit: str) -> float:
    """Return a requirement's bound in SI."""
    return units.parse(below, unit) if isinstance(below, str) else float(below)


def _quantile(error: np.ndarray[Any, Any], probability: float) -> float:
    """Return the order statistic that at least this fraction of the runs stays at or below."""
    if not len(error):
        return float("nan")
    return float(np.sort(error)[int(np.ceil(probability * len(error) - 1e-9)) - 1])


def told(value: float, unit: str) -> str:
    """Write a value with its unit, three digits; empty where there is none."""
    return "" if np.isnan(value) else f"{float(f'{value:.3g}'):g} {unit}"
