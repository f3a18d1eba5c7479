"""Verdicts on requirements at the required confidence, and the further runs that would decide the others."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import count, islice
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.metrics.basics.case import Errors, number_in
from lvnav_trade.metrics.basics.case_tables import CaseTables
from lvnav_trade.metrics.basics.probability import runs_needed, success_verdict
from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.evaluate import metric_in
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables

COLUMNS = [
    "requirement",
    "case",
    "verdict",
    "estimate",
    "limit",
    "unit",
    "probability",
    "confidence",
    "runs",
    "failures",
    "runs_to_decide",
]
# Word of a campaign that stops once every requirement is decided; runs in a block where it is not said.
DECIDED, BLOCK = "decided", 40
_NEGLIGIBLE = 1e-18
_FURTHEST = 100_000  # looks ahead for the number of further runs; beyond them there is no telling


@once
def verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdict on every requirement in every case.

    "met": the lower bound on the probability of success reaches the probability asked for; "violated": the upper bound
    stays below it; "undecided" otherwise. The bounds are exact binomial (Clopper and Pearson), each one-sided at the
    confidence asked for; where a campaign stops once all is decided, those of `boundaries`. A failed run is a failure.
    estimate: the error that the stated fraction of runs stays below, limit: the bound on it, both in `unit`;
    runs_to_decide: further runs, all good, after which it would be met.
    """
    rows = [
        (requirement["name"], label, *_verdict(tables, case, requirement))
        for requirement in tables.campaign.get("requirements") or ()
        for case, label in tables.labels.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def unselected(tables: Tables) -> list[str]:
    """Return the labels of the cases that the campaign's ``monte_carlo.selected`` leaves out; none where it selects
    none.
    """
    chosen = (tables.campaign.get("monte_carlo") or {}).get("selected") or {}
    return [
        tables.labels[case]
        for case, levels in tables.levels.items()
        if not all(str(levels.get(axis)) == str(level) for axis, level in chosen.items())
    ]


def decide_fixed(runs: int, failures: int, probability: float, confidence: float) -> tuple[str, int]:
    """Return the verdict and how many further runs, all of them good, would show that the requirement is met."""
    verdict = success_verdict(runs, failures, probability, confidence)
    return verdict, max(1, runs_needed(failures, probability, confidence) - runs) if verdict == "undecided" else 0


def decide_in_order(failed: Any, probability: float, confidence: float, block: int) -> tuple[str, int]:
    """Return verdict and further runs of a group-sequential test with one look per block of runs.

    failed (n_run,) truth values in the order of the runs; runs after the last whole block are not looked at.
    """
    counts = np.cumsum(np.asarray(failed, dtype=int))[block - 1 :: block].tolist()
    verdict, _ = decide(counts, probability, confidence, block)
    return verdict, further_runs(counts, probability, confidence, block) if verdict == "undecided" else 0


def _verdict(tables: Tables, case: str, requirement: dict[str, Any]) -> tuple[Any, ...]:
    """Return the values of `COLUMNS` from the verdict on."""
    probability, confidence = float(requirement["probability"]), float(requirement.get("confidence", 0.9))
    found = errors_of(tables, case, requirement)
    error, si, unit, factor = found or Errors(np.empty(0), "", "", 1.0)
    bound = number_in(requirement["below"], si) if found is not None else 0.0
    failed, stated = error >= bound, tables.campaign.get("monte_carlo") or {}
    if stated.get("stop") == DECIDED:
        verdict, more = decide_in_order(failed, probability, confidence, int(stated.get("block", BLOCK)))
    else:
        verdict, more = decide_fixed(len(error), int(failed.sum()), probability, confidence)
    estimate, limit = (size * factor for size in (_quantile(error, probability), bound if unit else float("nan")))
    return verdict, estimate, limit, unit, probability, confidence, len(error), int(failed.sum()), more


def errors_of(tables: Tables, case: str, requirement: Mapping[str, Any]) -> Errors | None:
    """Return the errors that a requirement is about, of every run of a case; None where its metric is unknown.

    Of a phase that is the largest error of each run at the times of the history within it, both ends included.
    """
    return metric_in(requirement).errors(CaseTables(tables, case), requirement)


def _quantile(error: np.ndarray[Any, Any], probability: float) -> float:
    """Return the order statistic that at least this fraction of the runs stays at or below."""
    return float(np.sort(error)[int(np.ceil(probability * len(error) - 1e-9)) - 1]) if len(error) else float("nan")


def with_unit(value: float, unit: str) -> str:
    """Write a value with its unit, three digits; empty where there is none, ∞ where so many runs failed."""
    return "" if np.isnan(value) else f"∞ {unit}" if np.isinf(value) else f"{float(f'{value:.3g}'):g} {unit}"


def in_words(frame: pd.DataFrame) -> pd.DataFrame:
    """Return verdicts in which estimate and limit are texts with their unit, as a page shows them."""
    texts = {
        name: [with_unit(value, unit) for value, unit in zip(frame[name], frame.unit, strict=True)]
        for name in ("estimate", "limit")
    }
    return frame.assign(**texts).drop(columns="unit")


def spent(runs: int, probability: float, confidence: float) -> float:
    """Return how much of the error 1 - confidence may have been spent on looks after so many runs.

    n / (n + n0) of it, n0 the runs that would decide without a failure at a single look. It depends on neither the
    number of runs planned nor on how many there will be: a campaign may be made longer after it was looked at.
    """
    return (1.0 - confidence) * runs / (runs + runs_needed(0, probability, confidence))


def _edges(side: int, probability: float, confidence: float, block: int) -> Iterator[int]:
    """Yield, look after look, the number of failures up to which (side 0) or from which (side 1) it is decided.

    Were the probability of success exactly the one asked for, the failures in n runs are binomial. Side 0 is the
    largest number at a look such that ever having been at or below it, at this look or before, has at most the
    probability spent; were the truth worse, that would be rarer still. Side 1, the other way round, shows a violation.
    Each of the two holds whether or not one stops at the other.
    """
    step: Floats = stats.binom.pmf(np.arange(block + 1), block, 1.0 - probability)
    first, mass, used = 0, np.ones(1), 0.0  # fewest failures that decide nothing, probabilities of that many and more
    for runs in count(block, block):
        mass = np.convolve(mass, step)
        from_edge = np.cumsum(mass if side == 0 else mass[::-1])
        allowed = spent(runs, probability, confidence) - used
        crossing = min(int(np.searchsorted(from_edge, allowed, side="right")), len(mass) - 1)  # something stays open
        used += float(from_edge[crossing - 1]) if crossing else 0.0
        if side == 0:
            yield first + crossing - 1
            first, mass = first + crossing, mass[crossing:]
        else:
            yield first + len(mass) - crossing
            mass = mass[: len(mass) - crossing]
        kept = np.flatnonzero(mass > _NEGLIGIBLE)
        if len(kept):  # what is too improbable to matter counts as spent
            cut = mass[kept[0] : kept[-1] + 1]
            used += float(mass.sum() - cut.sum())
            first, mass = first + int(kept[0]), cut


@lru_cache(maxsize=128)
def _known_edges(*asked: Any) -> tuple[list[int], Iterator[int]]:
    return [], _edges(*asked)


def _edge(side: int, look: int, probability: float, confidence: float, block: int) -> int:
    found, more = _known_edges(side, probability, confidence, block)
    found.extend(islice(more, max(0, look + 1 - len(found))))
    return found[look]


def boundaries(probability: float, confidence: float, block: int, looks: int) -> tuple[list[int], list[int]]:
    """Return for each look, after block, 2 block, ... runs: failures up to which the requirement is met (-1: none are
    few enough), and failures from which it is violated.
    """
    low, high = ([_edge(side, look, probability, confidence, block) for look in range(looks)] for side in (0, 1))
    return low, high


def decide(failures: Sequence[int], probability: float, confidence: float, block: int) -> tuple[str, int]:
    """Return the verdict of the first look that decides, and the runs after which it did, or else those looked at;
    `failures` (n_look,) are those of all runs up to each look.
    """
    low, high = boundaries(probability, confidence, block, len(failures))
    for look, failed in enumerate(failures):
        if failed <= low[look]:
            return "met", (look + 1) * block
        if failed >= high[look]:
            return "violated", (look + 1) * block
    return "undecided", len(failures) * block


def further_runs(failures: Sequence[int], probability: float, confidence: float, block: int) -> int:
    """Return how many further runs, all of them good, would show that a requirement is met that is still undecided."""
    beyond_bound, look = (failures[-1] if len(failures) else 0), len(failures)
    while look < _FURTHEST and beyond_bound > _edge(0, look, probability, confidence, block):
        look += 1
    return (min(look + 1, _FURTHEST) - len(failures)) * block
