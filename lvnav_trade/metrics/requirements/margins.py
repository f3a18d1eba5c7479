"""Margins of requirements: how far the error that counts is from its limit, case by case."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.requirements import confirmation
from lvnav_trade.metrics.requirements import improvements as by_covariance
from lvnav_trade.metrics.requirements import requirements as by_runs
from lvnav_trade.store.read import Tables

COLUMNS = ["requirement", "case", "verdict", "margin_ratio", "estimate", "limit", "unit", "by"]
WORST_RUNS = ["requirement", "case", "run_number", "error", "unit"]
_OF_EITHER = ("verdict", "estimate", "limit", "unit")
# Verdicts from the worst to the best
ORDER = ("violated", "not confirmed", "undecided", "not applicable", "met")


@once
def margins(tables: Tables) -> pd.DataFrame:
    """Return verdict and margin of every requirement in every case, the case with the smallest margin first.

    Of a case with runs they are those of the runs, of one without those of linear covariance; `by` says which. estimate
    is the error that the asked fraction of flights stays below; margin_ratio = 1 - estimate / limit, NaN where there
    is no estimate and -inf where so many runs failed.
    """
    return _ordered(confirmation.verdicts(tables))


def _ordered(both: pd.DataFrame) -> pd.DataFrame:
    """Return `margins` from verdicts with what they rest on."""
    both["margin_ratio"] = (1.0 - both.estimate / both.limit).astype(float)  # without requirements it is of no type
    cases, finite = both.case, both.margin_ratio.where(np.isfinite(both.margin_ratio))
    both["least"], both["finite"] = (one.groupby(cases).transform("min") for one in (both.margin_ratio, finite))
    return both.sort_values(["least", "finite"], kind="stable", ignore_index=True)[COLUMNS]


def worst(verdicts: pd.Series) -> str:
    """Return the worst of some verdicts."""
    return next(verdict for verdict in ORDER if (verdicts == verdict).any())


@once
def _unchecked(tables: Tables) -> pd.DataFrame:
    """Return `margins` without the spot check, which changes no margin and takes longer than all else here."""
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
    """Return label and role of the cases that decide: the one with the smallest margin, the one that keeps its limits
    with the smallest, and the one with the largest; empty without requirements.
    """
    least = _unchecked(tables).groupby("case", sort=False).margin_ratio.min().dropna()
    found: dict[str, str] = {}
    for rows, role in ((least[:1], "worst"), (least[least >= 0.0][:1], "binding"), (least[-1:], "best")):
        for case in rows.index:
            found.setdefault(str(case), role)
    return found


def worst_runs(tables: Tables) -> pd.DataFrame:
    """Return the run with the largest error of each requirement in the cases (digests) that decide, in its unit."""
    digests, rows = {label: case for case, label in tables.labels.items()}, []
    for requirement in tables.campaign.get("requirements") or ():
        for label in key_cases(tables):
            found = by_runs.errors_of(tables, digests[label], requirement)
            if found is not None and found.size.size:
                run = int(np.argmax(found.size))
                size = float(found.size[run]) * found.label_factor
                rows.append((requirement["name"], digests[label], run, size, found.label_unit))
    return pd.DataFrame(rows, columns=WORST_RUNS)
