"""Spot check of linear covariance by a few runs of each case; its verdicts do not count if they disagree."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, ncx2

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements import improvements as by_covariance
from lvnav_trade.results.requirements import requirements as by_runs
from lvnav_trade.results.statistics.select import NAVIGATION, at_time, cache_result, history_of, pick
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "event",
    "t_s",
    "error",
    "runs",
    "unit",
    "expected",
    "found",
    "ratio",
    "chance_ratio",
    "verdict",
]
# Probability that any row of a campaign disagrees by chance, with both engines describing the same errors
ALPHA = 0.01
# Predicted fraction of runs beyond the tested quantile
TAIL = 1e-3
NOT_CONFIRMED = "not confirmed"


@cache_result
def spot_check(tables: Tables) -> pd.DataFrame:
    """Return the comparison of the runs of the spot check with linear covariance; empty if there is no spot check.

    There are two kinds of rows. Navigation errors, at every event and at the first measurement after every gap: RMS of
    the runs over that of linear covariance; the p-value is of a noncentral chi-square distribution. Errors of
    requirements: number of runs beyond the predicted 99.9 % quantile, over the expected number; the p-value is
    binomial.

    verdict: "disagree" if the p-value is below 1 % divided by the number of rows of the campaign (Bonferroni),
    otherwise "agree"; "not applicable" if a gate or a mode logic makes linear covariance inapplicable to the case.
    """
    spot_tables = tables.with_frames(runs=tables.spot_runs)
    rows: list[dict[str, Any]] = []
    if len(spot_tables.runs):
        for case in tables.labels:
            rows += _navigation_rows(spot_tables, case)
            rows += _requirement_rows(spot_tables, case)
    frame = pd.DataFrame(rows, columns=COLUMNS[:-1])
    inapplicable = {label for case, label in tables.labels.items() if why_not_applicable(tables, case)}
    is_applicable = ~frame.case.isin(inapplicable)
    alpha = ALPHA / max(1, int(is_applicable.sum()))  # Bonferroni
    verdict = np.where(frame.chance_ratio < alpha, "disagree", "agree")
    return frame.assign(verdict=np.where(is_applicable, verdict, "not applicable"))


def _navigation_rows(spot_tables: Tables, case: str) -> list[dict[str, Any]]:
    """Return the rows of the navigation errors of a case."""
    rows: list[dict[str, Any]] = []
    statistics = []
    errors_by_event = _event_errors(pick(spot_tables.runs, case=case))
    for quantity, axis in spot_tables.display_units:
        if quantity not in NAVIGATION or axis == "3d":
            continue
        history = history_of(spot_tables, case, quantity, axis)
        if history.empty:
            continue
        unit, factor = spot_tables.display_units[quantity, axis]
        for event, (t, errors_by_axis) in errors_by_event.items():
            lincov_row = at_time(history, t)
            errors = errors_by_axis.get(f"{quantity}_{axis}")
            if errors is None or not lincov_row.lincov_true_si > 0.0:
                continue
            has_failed = not np.isfinite(errors).all()
            if has_failed:
                rms = np.inf
            else:
                rms = float(np.sqrt(np.mean(errors**2)))
            statistics.append((len(errors), lincov_row.lincov_true_si, lincov_row.lincov_mean_si, rms, factor))
            row = {
                "case": spot_tables.labels[case],
                "event": event,
                "t_s": t,
                "error": f"{quantity} {axis}",
                "runs": len(errors),
                "unit": unit,
            }
            rows.append(row)
    # With errors of mean m and sigma s, n rms^2 / s^2 is noncentral chi-square: n degrees, noncentrality n m^2 / s^2.
    n, sigma, mean, rms_of_runs, factors = np.array(statistics, dtype=float).reshape(-1, 5).T
    law = ncx2(n, n * (mean / sigma) ** 2)
    statistic = n * (rms_of_runs / sigma) ** 2
    chance = 2.0 * np.minimum(law.cdf(statistic), law.sf(statistic))  # two-sided
    expected_rms = np.hypot(sigma, mean)
    for k, row in enumerate(rows):
        row["expected"] = float(expected_rms[k] * factors[k])
        row["found"] = float(rms_of_runs[k] * factors[k])
        row["ratio"] = float(rms_of_runs[k] / expected_rms[k])
        row["chance_ratio"] = float(chance[k])
    return rows


def _event_errors(runs: pd.DataFrame) -> dict[str, tuple[float, dict[str, Floats]]]:
    """Return the time (s) of every event of a case and the errors (n,) of its runs there, by quantity and axis."""
    columns = {}
    for name in runs:
        if "_error_" in name:
            quantity_and_axis = "_".join(name.split("_")[:2])
            columns[quantity_and_axis] = runs[name].to_numpy(dtype=float)
    t = runs.t_s.to_numpy()
    errors_by_event = {}
    for event, rows in runs.groupby("event", sort=False).indices.items():
        errors = {name: column[rows] for name, column in columns.items()}
        t_event = float(t[rows[0]])
        errors_by_event[str(event)] = t_event, errors
    return errors_by_event


def _requirement_rows(spot_tables: Tables, case: str) -> list[dict[str, Any]]:
    """Return the rows of the requirements of a case, without phases, for which linear covariance gives a bound only."""
    rows = []
    for requirement in spot_tables.campaign.get("requirements") or ():
        if requirement.get("during"):
            continue
        requirement_case = by_covariance.evaluate_stored_requirement(spot_tables, requirement, case)
        errors = by_runs.errors_of(spot_tables, case, requirement)
        if isinstance(requirement_case, str) or errors is None or not errors.magnitude.size:
            continue
        n = errors.magnitude.size
        exceedance_count = int((errors.magnitude > requirement_case.quantile(1.0 - TAIL)).sum())
        event = event_or_phase(requirement)
        row = {
            "case": spot_tables.labels[case],
            "event": event,
            "t_s": float(pick(spot_tables.runs, case=case, event=event).t_s.iloc[0]),
            "error": f"{requirement['name']}, runs beyond the 99.9 % quantile",
            "runs": n,
            "unit": "",
            "expected": n * TAIL,
            "found": exceedance_count,
            "ratio": exceedance_count / (n * TAIL),
            "chance_ratio": float(binom.sf(exceedance_count - 1, n, TAIL)),
        }
        rows.append(row)
    return rows


def disagreement_texts(tables: Tables) -> dict[str, str]:
    """Return the reason why linear covariance is not confirmed, by label of the case: its least likely row in words."""
    frame = spot_check(tables)
    rows = frame[frame.verdict == "disagree"].sort_values("chance_ratio", kind="stable").drop_duplicates("case")
    return {row.case: _disagreement_text(row) for row in rows.itertuples()}


def _disagreement_text(row: Any) -> str:
    if " at " in row.event:
        moment = row.event
    else:
        moment = f"at {row.event.replace('_', ' ')}"
    if row.unit:
        result = f"{row.error} is {row.ratio:.3g} times what linear covariance predicts"
    else:
        result = f"{row.error}: {row.found:g} of {row.runs}, {row.expected:.2g} expected"
    return f"spot check of {row.runs} runs, {moment}: {result}"


@cache_result
def verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdict on every requirement in every case, with its method in the column `by`.

    by "runs": the verdict of `requirements.verdicts`, or "not confirmed" if the runs are undecided and the spot check
    disagrees with linear covariance. by "LinCov": verdict, estimate, limit and unit of `expected_verdicts`, for cases
    without runs, and for cases that are not selected for a demonstration (``monte_carlo.selected``) and undecided by
    their runs.
    """
    frame = by_runs.verdicts(tables)
    is_refuted = (frame.verdict == "undecided") & frame.case.isin(disagreement_texts(tables))
    verdict = frame.verdict.mask(is_refuted, NOT_CONFIRMED)
    frame = frame.assign(verdict=verdict, by="runs")
    keys = ["requirement", "case"]
    lincov = frame[keys].merge(expected_verdicts(tables), on=keys, how="left")
    lincov = lincov.set_index(frame.index)
    is_unselected = frame.case.isin(by_runs.unselected_cases(tables)) & (frame.verdict == "undecided")
    is_decided = is_unselected & lincov.verdict.isin(["met", "violated"])
    is_by_lincov = lincov.verdict.notna() & ((frame.runs == 0) | is_decided)
    for name in ("verdict", "estimate", "limit", "unit"):
        frame[name] = frame[name].mask(is_by_lincov, lincov[name])
    unit = frame.unit.fillna("")
    method = frame.by.mask(is_by_lincov, "LinCov")
    return frame.assign(unit=unit, by=method)


def expected_verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdicts by linear covariance, "not confirmed" with the reason if the spot check disagrees.

    Otherwise they are those of `improvements.lincov_verdicts`.
    """
    frame = by_covariance.lincov_verdicts(tables)
    reasons = disagreement_texts(tables)
    is_refuted = frame.verdict.isin(["met", "violated"]) & frame.case.isin(reasons)
    return frame.assign(
        verdict=frame.verdict.mask(is_refuted, NOT_CONFIRMED),
        reason=frame.reason.mask(is_refuted, frame.case.map(reasons)),
    )


def improvements(tables: Tables) -> pd.DataFrame:
    """Return the improvements by linear covariance that would meet requirements.

    Cases that meet the requirement and cases whose spot check disagrees are omitted.
    """
    frame = by_covariance.improvements(tables)
    met_rows = pick(verdicts(tables), verdict="met")
    met_pairs = set(zip(met_rows.requirement, met_rows.case, strict=True))
    pairs = zip(frame.requirement, frame.case, strict=True)
    is_met = np.array([pair in met_pairs for pair in pairs], dtype=bool)
    is_refuted = frame.case.isin(disagreement_texts(tables))
    return frame[~is_refuted & ~is_met].reset_index(drop=True)
