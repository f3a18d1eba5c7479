"""Linear covariance's own verdict on every requirement, and which better source would turn it into "met"."""

from collections.abc import Mapping
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize, special

from lvnav_trade.layout import LEVELS, MISSION, split_metric
from lvnav_trade.metrics.basics.probability import norm_probability, norm_quantile
from lvnav_trade.metrics.basics.select import flight_events, history_of, number_in, once, pick, rows_between
from lvnav_trade.metrics.errors.covariances import Gaussian, gaussian, why_not_applicable
from lvnav_trade.metrics.mechanics.mission import drawn_at, expected_at
from lvnav_trade.metrics.requirements.requirements import phase_of, verdicts, where
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables

UNKNOWN = "linear covariance does not hold this error there"
ABOVE_ONLY = "the worst of a phase: linear covariance bounds its probability from above only"
EXPECTED = [
    "requirement", "case", "verdict", "probability", "expected_probability", "estimate", "limit", "unit", "reason",
]  # fmt: skip
IMPROVEMENTS = ["requirement", "case", "verdict", "source", "factor_ratio", "share_ratio", "remark"]
# Smaller factors are no advice: no sensor gets twenty times better.
LEAST = 0.05


class Asked(NamedTuple):
    """A requirement in one case: the metric's Gaussian, bound (SI), probability, unit for people and its factor.

    moment: where the Gaussian is that of; above_only: it is that of the worst moment of a phase, so that the
    probability that it keeps the bound is no less than that of the whole phase; drawn: sizes (n,), growing, of a metric
    that is no Gaussian (an orbit that is circular to within its errors), which then stand for it.
    """

    law: Gaussian
    bound: float
    probability: float
    unit: str
    factor: float
    moment: str
    above_only: bool = False
    drawn: Floats | None = None

    def quantile(self, probability: float) -> float:
        """Return the size (SI) that the metric stays below with a probability."""
        if self.drawn is not None:
            return float(np.quantile(self.drawn, probability))
        return norm_quantile(self.law.mean, self.law.covariance, probability)

    def kept(self, sources: tuple[str, ...] = (), factor: float = 1.0) -> float:
        """Return the probability that the bound holds with the sigmas of sources multiplied, gains frozen."""
        if self.drawn is not None:
            return float(np.searchsorted(self.drawn, self.bound) / self.drawn.size)
        part = np.sum([self.law.sources[name] for name in sources], axis=0)
        return norm_probability(self.law.mean, self.law.covariance + (factor**2 - 1.0) * part, self.bound)


def asked(tables: Tables, requirement: Mapping[str, Any], case: str) -> Asked | str:
    """Return what linear covariance says of a requirement's error in a case, or why it says nothing."""
    metric, at = str(requirement["metric"]), where(requirement)
    quantity, axis = split_metric(metric)
    law: Gaussian | None
    if metric in LEVELS:
        return "a protection level is the same in every run"
    if metric in MISSION:
        found = expected_at(tables, case, at, metric)
        _, _, si, unit, factor = MISSION[metric]
        if not isinstance(found, tuple):
            drawn = drawn_at(tables, case, at, metric)
            if drawn is None:
                return found or UNKNOWN
            none, bound = Gaussian(np.empty(0), np.empty((0, 0)), {}), number_in(requirement["below"], si)
            return Asked(none, bound, float(requirement["probability"]), unit, float(factor), at, drawn=drawn)
        law = Gaussian(*found, {})
    elif (quantity, axis) in tables.people:
        unit, factor = tables.people[quantity, axis]
        si = str(pick(tables.outputs, quantity=quantity, axis=axis).unit.iloc[0])
        if requirement.get("during"):
            law, at = _worst(tables, requirement, case, number_in(requirement["below"], si)) or (None, at)
        else:
            law = gaussian(tables, case, at, quantity, axis)
    else:
        return UNKNOWN
    if law is None:
        return UNKNOWN
    bound, above_only = number_in(requirement["below"], si), bool(requirement.get("during")) and metric not in MISSION
    return Asked(law, bound, float(requirement["probability"]), unit, float(factor), at, above_only)


def _worst(tables: Tables, requirement: Mapping[str, Any], case: str, bound: float) -> tuple[Gaussian, str] | None:
    """Return the Gaussian of the moment of a phase that keeps the bound least, and which moment that is.

    A norm needs the covariance of three axes, which is kept at events; one axis is looked at at every time.
    """
    quantity, axis = split_metric(str(requirement["metric"]))
    phase = phase_of(tables, case, str(requirement["during"]))
    found: list[tuple[float, Gaussian, str]] = []
    for event in rows_between(flight_events(tables, case), *phase).event:
        law = gaussian(tables, case, event, quantity, axis)
        if law is not None:
            found.append((norm_probability(law.mean, law.covariance, bound), law, event.replace("_", " ")))
    rows = rows_between(history_of(tables, case, quantity, axis), *phase)
    rows = rows[(rows.lincov_true_si > 0.0) & (axis != "3d")]
    if len(rows):
        mean, sigma = rows.lincov_mean_si.to_numpy(), rows.lincov_true_si.to_numpy()
        kept = special.ndtr((bound - mean) / sigma) - special.ndtr((-bound - mean) / sigma)
        k = int(np.argmin(kept))
        law = Gaussian(mean[k : k + 1], sigma[k : k + 1, None] ** 2, {})
        found.append((float(kept[k]), law, f"{rows.t_s.iloc[k]:.0f} s"))
    return min(found, key=lambda one: one[0])[1:] if found else None


@once
def expected(tables: Tables) -> pd.DataFrame:
    """Return linear covariance's verdict on every requirement in every case, beside which the runs' one stands.

    expected_probability: that the error, Gaussian with LinCov's mean and covariance, stays below the bound (exact, see
    `norm_probability`). verdict: "met" or "violated" by it, "not applicable" with the reason where a gate
    rejects too many good rows. estimate: the error that the asked fraction stays below, in `unit`. Of the worst error
    in a phase the probability is no more than that of its worst moment, which is what stands there: it can show a
    violation only.
    """
    return pd.DataFrame([_expected(tables, *pair) for pair in _pairs(tables)], columns=EXPECTED)


def _expected(tables: Tables, requirement: Mapping[str, Any], case: str, found: Asked | str) -> dict[str, Any]:
    row = {"requirement": requirement["name"], "case": tables.labels[case]}
    row["probability"] = float(requirement["probability"])
    if isinstance(found, str):
        return row | {"verdict": "not applicable", "reason": found}
    limit = found.quantile(found.probability)
    why_not, kept = why_not_applicable(tables, case), found.kept()
    verdict, reason = ("met" if kept >= found.probability else "violated"), why_not
    if found.above_only:
        reason = reason or (f"already at {found.moment}" if verdict == "violated" else ABOVE_ONLY)
    shown = not why_not and (verdict == "violated" or not found.above_only)
    return row | {
        "verdict": verdict if shown else "not applicable",
        "reason": reason,
        "expected_probability": kept,
        "estimate": limit * found.factor,
        "limit": found.bound * found.factor,
        "unit": found.unit,
    }


def improvements(tables: Tables) -> pd.DataFrame:
    """Return what would make each violated or undecided requirement met, by linear covariance with gains frozen.

    source: the one source of error that needs the least improvement, or the fewest of the largest ones together;
    factor_ratio: what its sigma must be multiplied by; share_ratio: its part of the variance now. remark says it where
    nothing need be better, or where nothing that is known would do. By bisection on the probability that the Gaussian
    stays below the bound. The filter keeps the gains that it has: re-tuned to the better source it may do
    better or, where it neglects other errors, worse.
    """
    by_runs = verdicts(tables).set_index(["requirement", "case"]).verdict
    rows = []
    for requirement, case, found in _pairs(tables):
        name, label = requirement["name"], tables.labels[case]
        verdict = str(by_runs[name, label])
        undone = verdict in ("violated", "undecided") and not why_not_applicable(tables, case)
        if undone and not isinstance(found, str) and found.law.sources:
            rows.append((name, label, verdict, *_improvement(found)))
    return pd.DataFrame(rows, columns=IMPROVEMENTS)


@once
def _pairs(tables: Tables) -> list[tuple[dict[str, Any], str, Asked | str]]:
    return [
        (requirement, case, asked(tables, requirement, case))
        for requirement in tables.campaign.get("requirements") or ()
        for case in tables.labels
    ]


def _factor(found: Asked, names: tuple[str, ...]) -> float:
    """Return the largest factor on the sigmas of these sources that does; NaN where even `LEAST` does not."""

    def missing(factor: float) -> float:
        return found.kept(names, factor) - found.probability

    return float(optimize.bisect(missing, LEAST, 1.0, xtol=1e-4)) if missing(LEAST) >= 0.0 else float("nan")


def _improvement(found: Asked) -> tuple[str, float, float, str]:
    """Return source, factor_ratio, share_ratio and remark."""
    if found.kept() >= found.probability:
        return "", np.nan, np.nan, ABOVE_ONLY if found.above_only else "linear covariance expects it to be met as it is"
    source, factor, share, remark = _turning(found)
    alone = f"to keep it at {found.moment}; the whole phase may take more" if found.above_only else ""
    return source, factor, share, "; ".join(filter(None, [remark, alone]))


def _turning(found: Asked) -> tuple[str, float, float, str]:
    """Return the same for the source, or the fewest of the largest, that would turn a violated requirement."""
    total = float(np.trace(found.law.covariance) + found.law.mean @ found.law.mean)
    share = {name: float(np.trace(part)) / total for name, part in found.law.sources.items()}
    order = sorted(share, key=lambda name: -share[name])
    able = [(factor, name) for name in order if not np.isnan(factor := _factor(found, (name,)))]
    if able:
        factor, name = max(able)
        return name, factor, share[name], ""
    for names in accumulate((name,) for name in order):
        factor = _factor(found, names)
        if not np.isnan(factor):
            return ", ".join(names), factor, sum(share[name] for name in names), "together"
    return "", float("nan"), float("nan"), f"not even all error sources together, each times {LEAST:g}, would do"
