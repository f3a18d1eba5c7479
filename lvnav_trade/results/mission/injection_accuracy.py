"""Injection accuracy of guided ascents: achieved orbit against target, split into knowledge and execution."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import INJECTION as NUMBERS
from lvnav_trade.quantities.records import ORBIT, OUTCOMES, Floats, InjectionLaw
from lvnav_trade.results.mechanics.injection_law import APSIDES, apsis_errors, is_curved, share_depleted, why_no_law
from lvnav_trade.results.statistics.case_results import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.tables.read import Tables, pick
from lvnav_trade.results.tables.run_tables import INJECTION_UNITS, ORBIT_UNITS

INJECTION = [
    "case",
    "quantity",
    "unit",
    "runs",
    "mean_error",
    "sigma",
    "knowledge_sigma",
    "execution_sigma",
    "correlation_ratio",
    "q997",
    "lincov_mean",
    "lincov_sigma",
    "lincov_knowledge_sigma",
    "lincov_execution_sigma",
    "reason",
]
SOURCES = ["case", "quantity", "unit", "source", "source_group", "sigma", "share_ratio"]
TOGETHER, FLOWN = "all sources together", "spread of the runs"
CUTOFF = [
    "case",
    "runs",
    "injected_count",
    "depleted_count",
    "failed_count",
    "depleted_ratio",
    "low_ratio",
    "high_ratio",
    "cutoff_s",
    "cutoff_sigma_s",
    "propellant_left_kg",
    "propellant_left_sigma_kg",
    "propellant_left_minimum_kg",
    "lincov_depleted_ratio",
    "lincov_cutoff_s",
    "lincov_cutoff_sigma_s",
    "lincov_propellant_left_kg",
    "lincov_propellant_left_sigma_kg",
]
LOST = ["case", "run_number", "outcome", "t_s", "draws"]
_SHOWN_DRAWS = 4
LABELS = {
    "m": ("km", 1e-3),
    "rad": ("deg", 180.0 / np.pi),
    "dimensionless": ("-", 1.0),
    "s": ("s", 1.0),
    "kg": ("kg", 1.0),
}
_CONFIDENCE = 0.95


def injections_of(tables: Tables, case: str) -> dict[str, Injections]:
    """Return the runs for each orbital quantity of a case; empty without guidance, or without runs."""
    results = CaseTables(tables, case)
    injections = {}
    for quantity in ORBIT:
        runs = results.injections(quantity)
        if runs is not None:
            injections[quantity] = runs
    return injections


def injection(tables: Tables) -> pd.DataFrame:
    """Return the injection accuracy of each guided case: achieved less target, osculating, of runs that reach their
    cut-off, and the same by linear covariance.

    The error is the sum of knowledge (achieved less navigated) and execution (navigated less target). The two are
    correlated, so their variances do not add. Columns:

    q997 : 99.7 % quantile of |error|
    reason : why linear covariance does not describe the quantity

    Near a circular orbit, perigee and apogee are computed from draws of semi-major axis and eccentricity vector.
    """
    rows = []
    for case, label in tables.labels.items():
        runs = injections_of(tables, case)
        law = CaseTables(tables, case).injection_law()
        if not runs and law is None:
            continue
        for quantity in ORBIT:
            unit, factor = LABELS[ORBIT_UNITS[quantity]]
            row: dict[str, Any] = {"case": label, "quantity": quantity, "unit": unit, "runs": 0}
            if quantity in runs and runs[quantity].is_injected.any():
                row |= _run_columns(runs[quantity], factor)
            row |= _expected_columns(law, quantity, factor)
            rows.append(row)
    return pd.DataFrame(rows, columns=INJECTION)


def _expected_columns(law: InjectionLaw | None, quantity: str, factor: float) -> dict[str, Any]:
    """Return mean and sigmas of an injection error by linear covariance, or the reason why there are none.

    Parameters
    ----------
    law : InjectionLaw or None
        Distribution of the injection.
    quantity : str
        Element of the orbit.
    factor : float
        Factor from SI to the display unit.

    Returns
    -------
    dict of str to Any
        Values by column of the table, in the display unit.
    """
    if law is None:
        return {"reason": "no linear covariance"}
    reason = why_no_law(law, (quantity,))
    if reason:
        return {"reason": reason}
    if quantity in APSIDES and is_curved(law, quantity):
        draws = apsis_errors(law, quantity) * factor
        return {"lincov_mean": float(draws.mean()), "lincov_sigma": float(draws.std()), "reason": ""}
    k = ORBIT.index(quantity)
    return {
        "lincov_mean": float(law.mean[k]) * factor,
        "lincov_sigma": float(np.sqrt(law.covariance[:, k, k].sum())) * factor,
        "lincov_knowledge_sigma": float(np.sqrt(law.knowledge[:, k].sum())) * factor,
        "lincov_execution_sigma": float(np.sqrt(law.execution[:, k].sum())) * factor,
        "reason": "",
    }


def _run_columns(runs: Injections, factor: float) -> dict[str, Any]:
    """Return the statistics of an injection error and its parts over the runs that reach their cut-off.

    Parameters
    ----------
    runs : Injections
        Runs, for one orbital element.
    factor : float
        Factor from SI to the display unit.
    """
    error = runs.error[runs.is_injected] * factor
    knowledge = runs.knowledge[runs.is_injected] * factor
    execution = error - knowledge
    knowledge_sigma = _standard_deviation(knowledge)
    execution_sigma = _standard_deviation(execution)
    product = knowledge_sigma * execution_sigma
    correlation = np.nan
    if error.size > 1 and product > 0.0:
        correlation = float(np.cov(knowledge, execution)[0, 1]) / product
    return {
        "runs": error.size,
        "mean_error": float(error.mean()),
        "sigma": _standard_deviation(error),
        "knowledge_sigma": knowledge_sigma,
        "execution_sigma": execution_sigma,
        "correlation_ratio": correlation,
        "q997": float(np.quantile(np.abs(error), 0.997)),
    }


def _standard_deviation(values: Floats) -> float:
    """Return the standard deviation of a sample (n,); NaN for fewer than two values."""
    if values.size > 1:
        return float(values.std(ddof=1))
    return np.nan


def injection_sources(tables: Tables) -> pd.DataFrame:
    """Return the composition of one sigma of each injection error by linear covariance, largest source first.

    source_group : navigation or vehicle
    share_ratio : share of the sum of squares; all sources are independent, so their squares add

    For comparison, the table has the standard deviation over the runs, in which all sources act together.
    """
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        runs = injections_of(tables, case)
        law = CaseTables(tables, case).injection_law()
        if law is None:
            continue
        for k, quantity in enumerate(NUMBERS):
            if why_no_law(law, (quantity,)):
                continue
            sigma = np.sqrt(law.covariance[:, k, k])  # of each source
            if not sigma.size or not np.all(np.isfinite(sigma)):
                continue
            unit, factor = LABELS[INJECTION_UNITS[quantity]]
            name = {"case": label, "quantity": quantity, "unit": unit}
            rows += [name | row for row in _source_rows(law, sigma, factor)]
            run_sigma = _run_sigma(runs, quantity)
            if np.isfinite(run_sigma):
                rows.append(name | {"source": FLOWN, "source_group": "", "sigma": run_sigma * factor})
    return pd.DataFrame(rows, columns=SOURCES)


def _source_rows(law: InjectionLaw, sigma: Floats, factor: float) -> list[dict[str, Any]]:
    """Return the rows of the sources of an injection error, largest first, and the row of all sources together.

    Parameters
    ----------
    law : InjectionLaw
        Distribution of the injection, with the names of the sources.
    sigma : (n_source,) array
        Sigma by source, SI.
    factor : float
        Factor from SI to the display unit.
    """
    total = float(np.sqrt(np.sum(sigma**2)))
    rows = []
    for source in np.argsort(-sigma, kind="stable").tolist():
        rows.append(
            {
                "source": law.sources[source],
                "source_group": "navigation" if source < law.n_navigation else "vehicle",
                "sigma": sigma[source] * factor,
                "share_ratio": (sigma[source] / total) ** 2 if total > 0.0 else np.nan,
            }
        )
    rows.append({"source": TOGETHER, "source_group": "", "sigma": total * factor, "share_ratio": 1.0})
    return rows


def _run_sigma(runs: dict[str, Injections], quantity: str) -> float:
    """Return the standard deviation of an injection quantity over the runs that reach their cut-off."""
    if not runs:
        return np.nan
    injections = runs.get(quantity, runs[ORBIT[0]])
    if quantity == "cutoff_time":
        values = injections.t
    elif quantity == "propellant_left":
        values = injections.remaining_propellant
    else:
        values = injections.error
    return _standard_deviation(values[injections.is_injected])


def cutoff(tables: Tables) -> pd.DataFrame:
    """Return how guided ascents end: how many reach their cut-off, share of depletion with its exact 95 % interval,
    time of cut-off and residual propellant of the runs that reach it.

    failed_count : runs with diverged guidance or failed navigation
    """
    rows = []
    for case, label in tables.labels.items():
        law = CaseTables(tables, case).injection_law()
        injections = list(injections_of(tables, case).values())
        if not injections and law is None:
            continue
        row: dict[str, Any] = {
            "case": label,
            "runs": 0,
            "injected_count": 0,
            "depleted_count": 0,
            "failed_count": 0,
        }
        if injections:  # the end of a run is the same for all quantities
            row |= _end_columns(injections[0])
        row |= _expected_end(law)
        rows.append(row)
    return pd.DataFrame(rows, columns=CUTOFF)


def _end_columns(runs: Injections) -> dict[str, Any]:
    """Return how runs end: counts, share of depletion with its interval, cut-off time and residual propellant."""
    n_run = runs.outcome.size
    n_depleted = int(np.sum(runs.outcome == OUTCOMES[1]))
    n_injected = int(runs.is_injected.sum())
    success_low, success_high = success_bounds(n_run, n_depleted, 0.5 + 0.5 * _CONFIDENCE)
    cutoff_time = runs.t[runs.is_injected]
    propellant = runs.remaining_propellant[runs.is_injected]
    return {
        "runs": n_run,
        "injected_count": n_injected,
        "depleted_count": n_depleted,
        "failed_count": n_run - n_injected - n_depleted,
        "depleted_ratio": n_depleted / n_run,
        "low_ratio": 1.0 - success_high,
        "high_ratio": 1.0 - success_low,
        "cutoff_s": float(cutoff_time.mean()) if n_injected else np.nan,
        "cutoff_sigma_s": _standard_deviation(cutoff_time),
        "propellant_left_kg": float(propellant.mean()) if n_injected else np.nan,
        "propellant_left_sigma_kg": _standard_deviation(propellant),
        "propellant_left_minimum_kg": float(propellant.min()) if n_injected else np.nan,
    }


def _expected_end(law: InjectionLaw | None) -> dict[str, float]:
    """Return the probability of depletion, cut-off time and residual propellant with sigmas, by linear covariance.

    Columns to which linear covariance does not apply are missing.
    """
    if law is None or law.reason:
        return {}
    columns = {"lincov_depleted_ratio": share_depleted(law)}
    for quantity, column in (("cutoff_time", "cutoff"), ("propellant_left", "propellant_left")):
        if not why_no_law(law, (quantity,)):
            k = NUMBERS.index(quantity)
            unit = INJECTION_UNITS[quantity]
            columns[f"lincov_{column}_{unit}"] = float(law.mean[k])
            variance = law.covariance[:, k, k].sum()
            columns[f"lincov_{column}_sigma_{unit}"] = float(np.sqrt(variance))
    return columns


def failed_injections(tables: Tables) -> pd.DataFrame:
    """Return the runs of guided ascents that do not reach their cut-off: how and when they end, and the largest draws
    of their vehicle dispersions in sigmas, by source and number.
    """
    rows = []
    for case, label in tables.labels.items():
        ends = pick(tables.injections, case=case, quantity=ORBIT[0])
        case_draws = pick(tables.failed_injection_draws, case=case)
        for run in ends[ends.outcome != OUTCOMES[0]].itertuples():
            draws = case_draws[case_draws.run_number == run.run_number]
            order = np.argsort(-draws.draw_ratio.abs(), kind="stable")
            largest = draws.iloc[order[:_SHOWN_DRAWS]]
            texts = [
                f"{draw.source.replace('_', ' ')} {draw.draw_number + 1}: {draw.draw_ratio:+.1f}"
                for draw in largest.itertuples()
            ]
            rows.append(
                {
                    "case": label,
                    "run_number": run.run_number,
                    "outcome": run.outcome,
                    "t_s": float(run.t_s),
                    "draws": ", ".join(texts),
                }
            )
    return pd.DataFrame(rows, columns=LOST)
