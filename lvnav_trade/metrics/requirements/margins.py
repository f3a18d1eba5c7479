"""Margins of requirements: how far the error that counts is from its limit, case by case."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.requirements import confirmation
from lvnav_trade.store.read import Tables

COLUMNS = ["requirement", "case", "verdict", "margin_ratio", "estimate", "limit", "unit", "by"]
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
    frame, alone = confirmation.verdicts(tables), confirmation.expected(tables)
    alone = alone.reindex(columns=["requirement", "case", *_OF_EITHER])
    both = frame.merge(alone, on=["requirement", "case"], how="left", suffixes=("", "_lincov"))
    flown = (both.runs > 0) | both.verdict_lincov.isna()
    for name in _OF_EITHER:
        both[name] = both[name].where(flown, both[f"{name}_lincov"])
    both["by"] = np.where(flown, "runs", "LinCov")
    both["margin_ratio"] = (1.0 - both.estimate / both.limit).astype(float)  # without requirements it is of no type
    cases, finite = both.case, both.margin_ratio.where(np.isfinite(both.margin_ratio))
    both["least"], both["finite"] = (one.groupby(cases).transform("min") for one in (both.margin_ratio, finite))
    return both.sort_values(["least", "finite"], kind="stable", ignore_index=True)[COLUMNS]


def worst(verdicts: pd.Series) -> str:
    """Return the worst of some verdicts."""
    return next(verdict for verdict in ORDER if (verdicts == verdict).any())


def key_cases(tables: Tables) -> dict[str, str]:
    """Return label and role of the cases that decide: the one with the smallest margin, the one that keeps its limits
    with the smallest, and the one with the largest; empty without requirements.
    """
    least = margins(tables).groupby("case", sort=False).margin_ratio.min().dropna()
    found: dict[str, str] = {}
    for rows, role in ((least[:1], "worst"), (least[least >= 0.0][:1], "binding"), (least[-1:], "best")):
        for case in rows.index:
            found.setdefault(str(case), role)
    return found
