"""Margins of requirements: distance of the error from its limit, case by case."""

import numpy as np
import pandas as pd

from lvnav_trade.results.requirements import confirmation
from lvnav_trade.results.requirements import improvements as by_covariance
from lvnav_trade.results.requirements import requirements as by_runs
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.read import Tables

COLUMNS = ["requirement", "case", "verdict", "margin_ratio", "estimate", "limit", "unit", "by"]
WORST_RUNS = ["requirement", "case", "run_number", "error", "unit"]
_OF_EITHER = ("verdict", "estimate", "limit", "unit")
# Verdicts from the worst to the best
ORDER = ("violated", "not confirmed", "undecided", "not applicable", "met")


@once
def margins(tables: Tables) -> pd.DataFrame:
    """Return verdict and margin of every requirement in every case, the case with the smallest margin first.

    A case with runs has the verdicts of the runs, a case without runs those of linear covariance; the column `by` names
    the method. estimate is the P-quantile of the error, with the required probability P. margin_ratio is
    1 - estimate / limit: NaN without an estimate, -inf if too many runs failed.
    """
    return _ordered(confirmation.verdicts(tables))


def _ordered(both: pd.DataFrame) -> pd.DataFrame:
    """Return `margins` from verdicts with their method, sorted by the smallest margin of each case."""
    both["margin_ratio"] = (1.0 - both.estimate / both.limit).astype(float)  # the type of an empty column is undefined
    cases, finite = both.case, both.margin_ratio.where(np.isfinite(both.margin_ratio))
    both["least"], both["finite"] = (ratio.groupby(cases).transform("min") for ratio in (both.margin_ratio, finite))
    return both.sort_values(["least", "finite"], kind="stable", ignore_index=True)[COLUMNS]


def worst(verdicts: pd.Series) -> str:
    """Return the worst of several verdicts, in the order of `ORDER`."""
    return next(verdict for verdict in ORDER if (verdicts == verdict).any())


@once
def _unchecked(tables: Tables) -> pd.DataFrame:
    """Return `margins` without the spot check, which changes no margin and takes most of the time."""
    frame, alone = by_runs.verdicts(tables), by_covariance.expected(tables)
    alone = alone.reindex(columns=["requirement", "case", *_OF_EITHER])
    both = frame.merge(alone, on=["requirement", "case"], how="left", suffixes=("", "_lincov"))
    others = both.case.isin(by_runs.unselected(tables)) & (both.verdict == "undecided")
    taken = (both.runs == 0) | (others & both.verdict_lincov.isin(["met", "violated"]))
    simulated = ~taken | both.verdict_lincov.isna()
    for name in _OF_EITHER:
        both[name] = both[name].where(simulated, both[f"{name}_lincov"])
    return _ordered(both.assign(by=np.where(simulated, "runs", "LinCov")))


def key_cases(tables: Tables) -> dict[str, str]:
    """Return the role of the key cases, by label; empty without requirements.

    The key cases are those with the smallest margin ("worst"), with the smallest margin that is not negative
    ("binding"), and with the largest ("best").
    """
    least = _unchecked(tables).groupby("case", sort=False).margin_ratio.min().dropna()
    roles: dict[str, str] = {}
    for rows, role in ((least[:1], "worst"), (least[least >= 0.0][:1], "binding"), (least[-1:], "best")):
        for case in rows.index:
            roles.setdefault(str(case), role)
    return roles


def worst_runs(tables: Tables) -> pd.DataFrame:
    """Return the run with the largest error of each requirement in the key cases (by digest), in the display unit."""
    digests, rows = {label: case for case, label in tables.labels.items()}, []
    for requirement in tables.campaign.get("requirements") or ():
        for label in key_cases(tables):
            errors = by_runs.errors_of(tables, digests[label], requirement)
            if errors is not None and errors.size.size:
                run = int(np.argmax(errors.size))
                size = float(errors.size[run]) * errors.label_factor
                rows.append((requirement["name"], digests[label], run, size, errors.label_unit))
    return pd.DataFrame(rows, columns=WORST_RUNS)
