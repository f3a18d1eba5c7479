"""Margins of requirements: distance of the error from its limit, case by case."""

import numpy as np
import pandas as pd

from lvnav_trade.results.requirements import confirmation
from lvnav_trade.results.requirements import improvements as by_covariance
from lvnav_trade.results.requirements import requirements as by_runs
from lvnav_trade.results.statistics.select import cache_result
from lvnav_trade.results.tables.read import Tables

COLUMNS = ["requirement", "case", "verdict", "margin_ratio", "estimate", "limit", "unit", "by"]
WORST_RUNS = ["requirement", "case", "run_number", "error", "unit"]
_METHOD_COLUMNS = ("verdict", "estimate", "limit", "unit")  # given by the runs and by linear covariance
# Verdicts from the worst to the best
ORDER = ("violated", "not confirmed", "undecided", "not applicable", "met")


@cache_result
def margins(tables: Tables) -> pd.DataFrame:
    """Return verdict and margin of every requirement in every case, the case with the smallest margin first.

    A case with runs has the verdicts of the runs, a case without runs those of linear covariance; the column `by` names
    the method. estimate is the P-quantile of the error, with the required probability P. margin_ratio is
    1 - estimate / limit: NaN without an estimate, -inf if too many runs failed.
    """
    return _sort_margins(confirmation.verdicts(tables))


def _sort_margins(frame: pd.DataFrame) -> pd.DataFrame:
    """Return `margins` from verdicts with their method, sorted by the smallest margin of each case."""
    margin = (1.0 - frame.estimate / frame.limit).astype(float)  # the type of an empty column is undefined
    finite_margin = margin.where(np.isfinite(margin))
    rows = frame.assign(
        margin_ratio=margin,
        least=margin.groupby(frame.case).transform("min"),
        least_finite=finite_margin.groupby(frame.case).transform("min"),
    )
    return rows.sort_values(["least", "least_finite"], kind="stable", ignore_index=True)[COLUMNS]


def severest_verdict(verdicts: pd.Series) -> str:
    """Return the worst of several verdicts, in the order of `ORDER`."""
    present = set(verdicts)
    return next(verdict for verdict in ORDER if verdict in present)


@cache_result
def _margins_without_check(tables: Tables) -> pd.DataFrame:
    """Return `margins` without the spot check, which changes no margin and takes most of the time."""
    keys = ["requirement", "case"]
    lincov = by_covariance.lincov_verdicts(tables).reindex(columns=[*keys, *_METHOD_COLUMNS])
    frame = by_runs.verdicts(tables)
    frame = frame.merge(lincov, on=keys, how="left", suffixes=("", "_lincov"))
    is_unselected = frame.case.isin(by_runs.unselected_cases(tables)) & (frame.verdict == "undecided")
    is_decided = is_unselected & frame.verdict_lincov.isin(["met", "violated"])
    is_by_lincov = frame.verdict_lincov.notna() & ((frame.runs == 0) | is_decided)
    for name in _METHOD_COLUMNS:
        frame[name] = frame[name].mask(is_by_lincov, frame[f"{name}_lincov"])
    method = np.where(is_by_lincov, "LinCov", "runs")
    return _sort_margins(frame.assign(by=method))


def key_cases(tables: Tables) -> dict[str, str]:
    """Return the role of the key cases, by label; empty without requirements.

    The key cases are those with the smallest margin ("worst"), with the smallest margin that is not negative
    ("binding"), and with the largest ("best").
    """
    least_margin = _margins_without_check(tables).groupby("case", sort=False).margin_ratio.min().dropna()  # ascending
    met_margins = least_margin[least_margin >= 0.0]
    roles: dict[str, str] = {}
    candidates = ((least_margin[:1], "worst"), (met_margins[:1], "binding"), (least_margin[-1:], "best"))
    for rows, role in candidates:
        for case in rows.index:
            roles.setdefault(str(case), role)
    return roles


def worst_runs(tables: Tables) -> pd.DataFrame:
    """Return the run with the largest error of each requirement in the key cases (by digest), in the display unit."""
    rows = []
    digests = {label: case for case, label in tables.labels.items()}
    for requirement in tables.campaign.get("requirements") or ():
        for label in key_cases(tables):
            case = digests[label]
            errors = by_runs.errors_of(tables, case, requirement)
            if errors is not None and errors.magnitude.size:
                run = int(np.argmax(errors.magnitude))
                row = {
                    "requirement": requirement["name"],
                    "case": case,
                    "run_number": run,
                    "error": float(errors.magnitude[run]) * errors.label_factor,
                    "unit": errors.label_unit,
                }
                rows.append(row)
    return pd.DataFrame(rows, columns=WORST_RUNS)
