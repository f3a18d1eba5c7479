"""Linear covariance's own verdict on every requirement, and which better source would turn it into "met"."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.metrics.basics.gaussian import norm_probability, norm_quantile
from lvnav_trade.metrics.errors.covariances import reach
from lvnav_trade.metrics.requirements.distributions import ABOVE_ONLY, Asked, asked
from lvnav_trade.metrics.requirements.requirements import verdicts, with_unit
from lvnav_trade.store import Tables, load

EXPECTED = [
    "requirement", "case", "verdict", "probability", "expected_probability", "estimate", "limit", "reason",
]  # fmt: skip
IMPROVEMENTS = ["requirement", "case", "verdict", "source", "factor_ratio", "share_ratio", "remark"]
LEAST = 0.05
"""Smaller factors are no advice: no sensor gets twenty times better."""


def expected(results: Path | str | Tables) -> pd.DataFrame:
    """Return linear covariance's verdict on every requirement in every case, beside which the runs' one stands.

    expected_probability: that the error, Gaussian with LinCov's mean and covariance, stays below the bound (exact, see
    `gaussian.norm_probability`). verdict: "met" or "violated" by it, "not applicable" with the reason where a gate
    rejects too many good rows. estimate: the error that the asked fraction stays below. Of the worst error in a phase
    the probability is no more than that of its worst moment, which is what stands there: it can show a violation only.
    """
    tables = load(results)
    rows = []
    for requirement, case, found in _pairs(tables):
        row: dict[str, Any] = {"requirement": requirement["name"], "case": tables.labels[case]}
        row["probability"] = float(requirement["probability"])
        rows.append(row | _expected(tables, case, found))
    return pd.DataFrame(rows, columns=EXPECTED)


def _expected(tables: Tables, case: str, found: Asked | str) -> dict[str, Any]:
    if isinstance(found, str):
        return {"verdict": "not applicable", "reason": found}
    kept = norm_probability(found.law.mean, found.law.covariance, found.bound)
    limit = norm_quantile(found.law.mean, found.law.covariance, found.probability)
    extent = reach(tables, case)
    verdict, reason = ("met" if kept >= found.probability else "violated"), extent.reason
    if found.above_only:
        reason = reason or (f"already at {found.moment}" if verdict == "violated" else ABOVE_ONLY)
        verdict = verdict if verdict == "violated" else "not applicable"
    return {
        "verdict": verdict if extent.applies else "not applicable",
        "reason": reason,
        "expected_probability": kept,
        "estimate": with_unit(limit * found.factor, found.unit),
        "limit": with_unit(found.bound * found.factor, found.unit),
    }


def improvements(results: Path | str | Tables) -> pd.DataFrame:
    """Return what would make each violated or undecided requirement met, by linear covariance with gains frozen.

    source: the one source of error that needs the least improvement, or the fewest of the largest ones together;
    factor_ratio: what its sigma must be multiplied by; share_ratio: its part of the variance now. remark says it where
    nothing need be better, or where nothing that is known would do. By bisection on the probability that the Gaussian
    stays below the bound. The filter keeps the gains that it has: re-tuned to the better source it may do
    better or, where it neglects other errors, worse.
    """
    tables = load(results)
    by_runs = verdicts(tables).set_index(["requirement", "case"]).verdict
    rows = []
    for requirement, case, found in _pairs(tables):
        verdict = str(by_runs[requirement["name"], tables.labels[case]])
        open_ = verdict in ("violated", "undecided") and reach(tables, case).applies
        if open_ and not isinstance(found, str) and found.law.sources:
            row = {"requirement": requirement["name"], "case": tables.labels[case], "verdict": verdict}
            rows.append(row | _improvement(found))
    return pd.DataFrame(rows, columns=IMPROVEMENTS)


def _pairs(tables: Tables) -> list[tuple[dict[str, Any], str, Asked | str]]:
    """Return every requirement with every case and what is asked of it."""
    return [
        (requirement, case, asked(tables, requirement, case))
        for requirement in tables.campaign.get("requirements") or ()
        for case in tables.labels
    ]


def probability_with(found: Asked, source: str | tuple[str, ...], factor: float) -> float:
    """Return the probability that the bound holds with the sigma of a source (or several) multiplied, gains frozen."""
    names = (source,) if isinstance(source, str) else source
    part = np.sum([found.law.sources[name] for name in names], axis=0)
    return norm_probability(found.law.mean, found.law.covariance + (factor**2 - 1.0) * part, found.bound)


def _factor(found: Asked, names: tuple[str, ...]) -> float:
    """Return the largest factor on the sigmas of these sources that does; NaN where even `LEAST` does not."""

    def missing(factor: float) -> float:
        return probability_with(found, names, factor) - found.probability

    return float(optimize.bisect(missing, LEAST, 1.0, xtol=1e-4)) if missing(LEAST) >= 0.0 else float("nan")


def _improvement(found: Asked) -> dict[str, Any]:
    if norm_probability(found.law.mean, found.law.covariance, found.bound) >= found.probability:
        as_it_is = "linear covariance expects it to be met as it is"
        return {"source": "", "remark": ABOVE_ONLY if found.above_only else as_it_is}
    row = _turning(found)
    alone = f"to keep it at {found.moment}; the whole phase may take more"
    return row | {"remark": "; ".join(filter(None, [row["remark"], alone]))} if found.above_only else row


def _turning(found: Asked) -> dict[str, Any]:
    """Return the source, or the fewest of the largest, that would turn a violated requirement."""
    total = float(np.trace(found.law.covariance) + found.law.mean @ found.law.mean)
    share = {name: float(np.trace(part)) / total for name, part in found.law.sources.items()}
    order = sorted(share, key=lambda name: -share[name])
    single = [(_factor(found, (name,)), name) for name in order]
    able = [(factor, name) for factor, name in single if factor == factor]
    if able:
        factor, name = max(able)
        return {"source": name, "factor_ratio": factor, "share_ratio": share[name], "remark": ""}
    for names in accumulate((name,) for name in order):
        factor = _factor(found, names)
        if factor == factor:
            part = sum(share[name] for name in names)
            return {"source": ", ".join(names), "factor_ratio": factor, "share_ratio": part, "remark": "together"}
    return {"source": "", "remark": f"not even all error sources together, each times {LEAST:g}, would do"}
