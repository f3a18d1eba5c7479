"""Verdicts of runs on requirements at the required confidence, and the further runs needed for a decision."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import count, islice
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluate import metric_in
from lvnav_trade.results.statistics.case_results import RunErrors, number_in
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import runs_needed, success_verdict
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.read import Tables

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
# Value of `stop` for a campaign that stops once every requirement is decided; default number of runs of a block
DECIDED, BLOCK = "decided", 40
_NEGLIGIBLE = 1e-18  # probability
_FURTHEST = 100_000  # largest number of further looks that is searched


@once
def verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdict on every requirement in every case.

    Parameters
    ----------
    tables : Tables
        Tables of the results.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`. estimate: P-quantile of the error, P the required probability; limit: bound of the
        requirement; both in `unit`. runs_to_decide: number of further runs that meet the requirement, with no failure
        among them, after which the verdict would be "met".

    Notes
    -----
    "met": the lower confidence bound on the probability of success reaches the required probability. "violated": the
    upper bound is below it. "undecided" otherwise. The bounds are exact binomial (Clopper and Pearson), each one-sided
    at the required confidence. In a campaign that stops once all requirements are decided, the bounds are those of a
    group-sequential test (`boundaries`). A failed run counts as a violation.
    """
    rows = [
        (requirement["name"], label, *_verdict(tables, case, requirement))
        for requirement in tables.campaign.get("requirements") or ()
        for case, label in tables.labels.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def unselected(tables: Tables) -> list[str]:
    """Return the labels of the cases that ``monte_carlo.selected`` excludes; empty without a selection."""
    chosen = (tables.campaign.get("monte_carlo") or {}).get("selected") or {}
    return [
        tables.labels[case]
        for case, levels in tables.levels.items()
        if not all(str(levels.get(axis)) == str(level) for axis, level in chosen.items())
    ]


def decide_fixed(runs: int, failures: int, probability: float, confidence: float) -> tuple[str, int]:
    """Return the verdict after a fixed number of runs, and the further runs without failure that would meet it."""
    verdict = success_verdict(runs, failures, probability, confidence)
    return verdict, max(1, runs_needed(failures, probability, confidence) - runs) if verdict == "undecided" else 0


def sequential_verdict(failed: Any, probability: float, confidence: float, block: int) -> tuple[str, int]:
    """Return the verdict of a group-sequential test with one look per block, and the further runs to meet it.

    Parameters
    ----------
    failed : (n_run,) array of bool
        Whether each run violates the requirement, in the order of the runs. Runs after the last complete block are
        ignored.
    probability, confidence : float
        Required probability and confidence.
    block : int
        Runs per block.

    Returns
    -------
    str, int
        met, violated or undecided; number of further runs without failure.
    """
    counts = np.cumsum(np.asarray(failed, dtype=int))[block - 1 :: block].tolist()
    verdict, _ = decide(counts, probability, confidence, block)
    return verdict, further_runs(counts, probability, confidence, block) if verdict == "undecided" else 0


def _verdict(tables: Tables, case: str, requirement: dict[str, Any]) -> tuple[Any, ...]:
    """Return the values of `COLUMNS`, beginning with the verdict."""
    probability, confidence = float(requirement["probability"]), float(requirement.get("confidence", 0.9))
    errors = errors_of(tables, case, requirement)
    error, si, unit, factor = errors or RunErrors(np.empty(0), "", "", 1.0)
    bound = number_in(requirement["below"], si) if errors is not None else 0.0
    failed, monte_carlo = error >= bound, tables.campaign.get("monte_carlo") or {}
    if monte_carlo.get("stop") == DECIDED:
        verdict, more = sequential_verdict(failed, probability, confidence, int(monte_carlo.get("block", BLOCK)))
    else:
        verdict, more = decide_fixed(len(error), int(failed.sum()), probability, confidence)
    estimate, limit = (size * factor for size in (_quantile(error, probability), bound if unit else float("nan")))
    return verdict, estimate, limit, unit, probability, confidence, len(error), int(failed.sum()), more


def errors_of(tables: Tables, case: str, requirement: Mapping[str, Any]) -> RunErrors | None:
    """Return the error bounded by a requirement in every run of a case; None if the results do not have its metric.

    For a phase it is the largest error of each run at the history times of the phase, both ends included.
    """
    return metric_in(requirement).errors(CaseTables(tables, case), requirement)


def _quantile(error: np.ndarray[Any, Any], probability: float) -> float:
    """Return the smallest order statistic that at least this fraction of the runs does not exceed."""
    return float(np.sort(error)[int(np.ceil(probability * len(error) - 1e-9)) - 1]) if len(error) else float("nan")


def with_unit(value: float, unit: str) -> str:
    """Return a value with its unit as text, three digits; empty for NaN, ∞ if too many runs failed."""
    return "" if np.isnan(value) else f"∞ {unit}" if np.isinf(value) else f"{float(f'{value:.3g}'):g} {unit}"


def in_words(frame: pd.DataFrame) -> pd.DataFrame:
    """Return verdicts for display, with estimate and limit as texts with their unit."""
    texts = {
        name: [with_unit(value, unit) for value, unit in zip(frame[name], frame.unit, strict=True)]
        for name in ("estimate", "limit")
    }
    return frame.assign(**texts).drop(columns="unit")


def spent(runs: int, probability: float, confidence: float) -> float:
    """Return the error probability that may have been spent after a number of runs (error-spending function).

    It is (1 - confidence) n / (n + n0), with n0 the runs without failure that decide at a single look. It depends on
    neither the planned nor the final number of runs, so a campaign may be extended after looking at its results.
    """
    return (1.0 - confidence) * runs / (runs + runs_needed(0, probability, confidence))


def _edges(side: int, probability: float, confidence: float, block: int) -> Iterator[int]:
    """Yield, look by look, the number of failures up to which (side 0) or from which (side 1) the test decides.

    If the probability of success is exactly the required one, the number of failures in n runs is binomial. The edge of
    side 0 is the largest number such that the probability of having been at or below an edge, at this look or before,
    is at most the probability `spent`. If the truth is worse, this probability is smaller still. Side 1 is the mirror
    image and shows a violation. Each side is valid whether or not the campaign stops at the other.
    """
    step: Floats = stats.binom.pmf(np.arange(block + 1), block, 1.0 - probability)
    # mass: probabilities of `first`, first + 1, ... failures without a decision so far
    first, mass, used = 0, np.ones(1), 0.0
    for runs in count(block, block):
        mass = np.convolve(mass, step)
        from_edge = np.cumsum(mass if side == 0 else mass[::-1])
        allowed = spent(runs, probability, confidence) - used
        # at least one number of failures stays undecided
        crossing = min(int(np.searchsorted(from_edge, allowed, side="right")), len(mass) - 1)
        used += float(from_edge[crossing - 1]) if crossing else 0.0
        if side == 0:
            yield first + crossing - 1
            first, mass = first + crossing, mass[crossing:]
        else:
            yield first + len(mass) - crossing
            mass = mass[: len(mass) - crossing]
        kept = np.flatnonzero(mass > _NEGLIGIBLE)
        if len(kept):  # negligible probabilities are dropped and counted as spent, which is on the safe side
            cut = mass[kept[0] : kept[-1] + 1]
            used += float(mass.sum() - cut.sum())
            first, mass = first + int(kept[0]), cut


@lru_cache(maxsize=128)
def _known_edges(*asked: Any) -> tuple[list[int], Iterator[int]]:
    return [], _edges(*asked)


def _edge(side: int, look: int, probability: float, confidence: float, block: int) -> int:
    edges, more = _known_edges(side, probability, confidence, block)
    edges.extend(islice(more, max(0, look + 1 - len(edges))))
    return edges[look]


def boundaries(probability: float, confidence: float, block: int, looks: int) -> tuple[list[int], list[int]]:
    """Return the boundaries of the group-sequential test.

    Parameters
    ----------
    probability, confidence : float
        Required probability and confidence.
    block : int
        Runs between looks.
    looks : int
        Number of looks.

    Returns
    -------
    list of int, list of int
        For each look the number of failures up to which the requirement is met (-1: not even without failures), and
        the number from which it is violated.
    """
    low, high = ([_edge(side, look, probability, confidence, block) for look in range(looks)] for side in (0, 1))
    return low, high


def decide(failures: Sequence[int], probability: float, confidence: float, block: int) -> tuple[str, int]:
    """Return the verdict of the first look that decides, and the number of runs at this look.

    Parameters
    ----------
    failures : (n_look,) sequence of int
        Cumulative number of failures at each look.
    probability, confidence : float
        Required probability and confidence.
    block : int
        Runs between looks.

    Returns
    -------
    str, int
        met, violated or undecided; number of runs at the decision, or at the last look.
    """
    low, high = boundaries(probability, confidence, block, len(failures))
    for look, failed in enumerate(failures):
        if failed <= low[look]:
            return "met", (look + 1) * block
        if failed >= high[look]:
            return "violated", (look + 1) * block
    return "undecided", len(failures) * block


def further_runs(failures: Sequence[int], probability: float, confidence: float, block: int) -> int:
    """Return the number of further runs without failure after which an undecided requirement would be met."""
    beyond_bound, look = (failures[-1] if len(failures) else 0), len(failures)
    while look < _FURTHEST and beyond_bound > _edge(0, look, probability, confidence, block):
        look += 1
    return (min(look + 1, _FURTHEST) - len(failures)) * block
