"""Linear covariance's own verdict on every requirement, and which better source would turn it into "met"."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.metrics.covariances import Gaussian, gaussian, reach
from lvnav_trade.metrics.gaussian import norm_probability, norm_quantile
from lvnav_trade.metrics.requirements import bound_of, told, verdicts
from lvnav_trade.metrics.select import split_metric
from lvnav_trade.store import Tables, load

EXPECTED = [
    "requirement", "case", "verdict", "probability", "expected_probability", "estimate", "limit", "reason",
]  # fmt: skip
LEVERS = ["requirement", "case", "verdict", "source", "factor_ratio", "share_ratio", "remark"]
LEAST = 0.05
"""Smaller factors are no advice: no sensor gets twenty times better."""


class Asked(NamedTuple):
    """A requirement in one case: the metric's Gaussian at the event, bound (SI), probability, unit and its factor."""

    law: Gaussian
    bound: float
    probability: float
    unit: str
    factor: float


def expected(results: Path | str | Tables) -> pd.DataFrame:
    """Return linear covariance's verdict on every requirement in every case, beside which the runs' one stands.

    expected_probability: that the error, Gaussian with LinCov's mean and covariance, stays below the bound (exact, see
    `gaussian.norm_probability`). verdict: "met" or "violated" by it, "not applicable" with the reason where a gate
    rejects too many good rows. estimate: the error that the asked fraction stays below.
    """
    tables = load(results)
    rows = []
    for requirement, case, asked in _pairs(tables):
        row: dict[str, Any] = {"requirement": requirement["name"], "case": tables.labels[case]}
        row["probability"] = float(requirement["probability"])
        if asked is None:
            row |= {"verdict": "not applicable", "reason": "linear covariance does not hold this error there"}
        else:
            found = norm_probability(asked.law.mean, asked.law.covariance, asked.bound)
            limit = norm_quantile(asked.law.mean, asked.law.covariance, asked.probability)
            extent = reach(tables, case)
            verdict = ("met" if found >= asked.probability else "violated") if extent.applies else "not applicable"
            row |= {"verdict": verdict, "reason": extent.reason, "expected_probability": found}
            row |= {
                "estimate": told(limit * asked.factor, asked.unit),
                "limit": told(asked.bound * asked.factor, asked.unit),
            }
        rows.append(row)
    return pd.DataFrame(rows, columns=EXPECTED)


def levers(results: Path | str | Tables) -> pd.DataFrame:
    """Return what would make each violated or undecided requirement met, by linear covariance with gains frozen.

    source: the one source of error that needs the least improvement, or the fewest of the largest ones together;
    factor_ratio: what its sigma must be multiplied by; share_ratio: its part of the variance now. remark says it where
    nothing need be better, or where nothing that is known would do. By bisection on the probability that the Gaussian
    stays below the bound. The filter keeps the gains that it has: re-tuned to the better source it may do
    better or, where it neglects other errors, worse.
    """
    tables = load(results)
    judged = verdicts(tables).set_index(["requirement", "case"]).verdict
    rows = []
    for requirement, case, asked in _pairs(tables):
        verdict = str(judged[requirement["name"], tables.labels[case]])
        if (
            verdict in ("violated", "undecided")
            and asked is not None
            and asked.law.sources
            and reach(tables, case).applies
        ):
            row = {"requirement": requirement["name"], "case": tables.labels[case], "verdict": verdict}
            rows.append(row | _lever(asked))
    return pd.DataFrame(rows, columns=LEVERS)


def _pairs(tables: Tables) -> list[tuple[dict[str, Any], str, Asked | None]]:
    """Return every requirement with every case and what is asked of it."""
    return [
        (requirement, case, _asked(tables, requirement, case))
        for requirement in tables.campaign.get("requirements") or ()
        for case in tables.labels
    ]


def _asked(tables: Tables, requirement: dict[str, Any], case: str) -> Asked | None:
    quantity, axis = split_metric(requirement["metric"])
    law = gaussian(tables, case, requirement.get("at", "injection"), quantity, axis)
    if law is None:
        return None
    unit, factor = tables.people[quantity, axis]
    outputs = tables.outputs
    si = outputs[(outputs.quantity == quantity) & (outputs.axis == axis)].unit.iloc[0]
    return Asked(law, bound_of(requirement["below"], si), float(requirement["probability"]), unit, factor)


def probability_with(asked: Asked, source: str | tuple[str, ...], factor: float) -> float:
    """Return the probability that the bound holds with the sigma of a source (or several) multiplied, gains frozen."""
    names = (source,) if isinstance(source, str) else source
    part = np.sum([asked.law.sources[name] for name in names], axis=0)
    return norm_probability(asked.law.mean, asked.law.covariance + (factor**2 - 1.0) * part, asked.bound)


def _factor(asked: Asked, names: tuple[str, ...]) -> float:
    """Return the largest factor on the sigmas of these sources that does; NaN where even `LEAST` does not."""

    def missing(factor: float) -> float:
        return probability_with(asked, names, factor) - asked.probability

    return float(optimize.bisect(missing, LEAST, 1.0, xtol=1e-4)) if missing(LEAST) >= 0.0 else float("nan")


def _lever(asked: Asked) -> dict[str, Any]:
    if norm_probability(asked.law.mean, asked.law.covariance, asked.bound) >= asked.probability:
        return {"source": "", "remark": "linear covariance expects it to be met as it is"}
    total = float(np.trace(asked.law.covariance) + asked.law.mean @ asked.law.mean)
    share = {name: float(np.trace(part)) / total for name, part in asked.law.sources.items()}
    order = sorted(share, key=lambda name: -share[name])
    single = [(_factor(asked, (name,)), name) for name in order]
    able = [(factor, name) for factor, name in single if factor == factor]
    if able:
        factor, name = max(able)
        return {"source": name, "factor_ratio": factor, "share_ratio": share[name], "remark": ""}
    for names in accumulate((name,) for name in order):
        factor = _factor(asked, names)
        if factor == factor:
            part = sum(share[name] for name in names)
            return {"source": ", ".join(names), "factor_ratio": factor, "share_ratio": part, "remark": "together"}
    return {"source": "", "remark": f"not even all error sources together, each times {LEAST:g}, would do"}
