"""Verdicts of runs on requirements at the required confidence, and the further runs needed for a decision."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import count, islice
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluate import statement_metric
from lvnav_trade.results.statistics.case_results import RunErrors, parse_number
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import runs_needed, success_verdict
from lvnav_trade.results.statistics.select import cache_result
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


@cache_result
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
    rows = []
    for requirement in tables.campaign.get("requirements") or ():
        for case, label in tables.labels.items():
            rows.append({"requirement": requirement["name"], "case": label, **_verdict(tables, case, requirement)})
    return pd.DataFrame(rows, columns=COLUMNS)


def unselected_cases(tables: Tables) -> list[str]:
    """Return the labels of the cases that ``monte_carlo.selected`` excludes; empty without a selection."""
    selection = (tables.campaign.get("monte_carlo") or {}).get("selected") or {}
    labels = []
    for case, levels in tables.levels.items():
        is_excluded = any(str(levels.get(axis)) != str(level) for axis, level in selection.items())
        if is_excluded:
            labels.append(tables.labels[case])
    return labels


def decide_fixed(runs: int, failures: int, probability: float, confidence: float) -> tuple[str, int]:
    """Return the verdict after a fixed number of runs, and the further runs without failure that would meet it.

    Parameters
    ----------
    runs, failures : int
        Number of runs, and of failures among them.
    probability, confidence : float
        Required probability and confidence.

    Returns
    -------
    str, int
        met, violated or undecided; number of further runs, 0 if the verdict is decided.
    """
    verdict = success_verdict(runs, failures, probability, confidence)
    if verdict != "undecided":
        return verdict, 0
    return verdict, max(1, runs_needed(failures, probability, confidence) - runs)


def sequential_verdict(is_violated: Any, probability: float, confidence: float, block: int) -> tuple[str, int]:
    """Return the verdict of a group-sequential test with one look per block, and the further runs to meet it.

    Parameters
    ----------
    is_violated : (n_run,) array of bool
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
    failures_by_run = np.cumsum(np.asarray(is_violated, dtype=int))
    failures_by_look = failures_by_run[block - 1 :: block].tolist()
    verdict, _ = decide(failures_by_look, probability, confidence, block)
    if verdict != "undecided":
        return verdict, 0
    return verdict, further_runs(failures_by_look, probability, confidence, block)


def _verdict(tables: Tables, case: str, requirement: dict[str, Any]) -> dict[str, Any]:
    """Return the values of `COLUMNS` from the verdict on."""
    probability = float(requirement["probability"])
    confidence = float(requirement.get("confidence", 0.9))
    errors = errors_of(tables, case, requirement)
    if errors is None:
        errors = RunErrors(np.empty(0), "", "", 1.0)
        bound = 0.0
    else:
        bound = parse_number(requirement["below"], errors.unit)
    is_failed = errors.magnitude >= bound
    n_run = len(errors.magnitude)
    n_failed = int(is_failed.sum())
    monte_carlo = tables.campaign.get("monte_carlo") or {}
    if monte_carlo.get("stop") == DECIDED:
        block = int(monte_carlo.get("block", BLOCK))
        verdict, further_count = sequential_verdict(is_failed, probability, confidence, block)
    else:
        verdict, further_count = decide_fixed(n_run, n_failed, probability, confidence)
    return {
        "verdict": verdict,
        "estimate": _quantile(errors.magnitude, probability) * errors.label_factor,
        "limit": bound * errors.label_factor if errors.label_unit else float("nan"),
        "unit": errors.label_unit,
        "probability": probability,
        "confidence": confidence,
        "runs": n_run,
        "failures": n_failed,
        "runs_to_decide": further_count,
    }


def errors_of(tables: Tables, case: str, requirement: Mapping[str, Any]) -> RunErrors | None:
    """Return the error bounded by a requirement in every run of a case; None if the results do not have its metric.

    For a phase it is the largest error of each run at the history times of the phase, both ends included.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    requirement : mapping
        The requirement, as in the campaign.
    """
    return statement_metric(requirement).errors(CaseTables(tables, case), requirement)


def _quantile(error: np.ndarray[Any, Any], probability: float) -> float:
    """Return the smallest order statistic that at least this fraction of the runs does not exceed."""
    if not len(error):
        return float("nan")
    rank = int(np.ceil(probability * len(error) - 1e-9))  # from 1; the product may be an integer but for rounding
    return float(np.sort(error)[rank - 1])


def with_unit(value: float, unit: str) -> str:
    """Return a value with its unit as text, three digits; empty for NaN, ∞ if too many runs failed."""
    if np.isnan(value):
        return ""
    if np.isinf(value):
        return f"∞ {unit}"
    rounded_value = float(f"{value:.3g}")
    return f"{rounded_value:g} {unit}"


def verdict_texts(frame: pd.DataFrame) -> pd.DataFrame:
    """Return verdicts for display, with estimate and limit as texts with their unit."""
    texts = {
        name: [with_unit(value, unit) for value, unit in zip(frame[name], frame.unit, strict=True)]
        for name in ("estimate", "limit")
    }
    return frame.assign(**texts).drop(columns="unit")


def error_spending(runs: int, probability: float, confidence: float) -> float:
    """Return the error probability that may have been spent after a number of runs (error-spending function).

    Parameters
    ----------
    runs : int
        Number n of runs at the look.
    probability, confidence : float
        Required probability of success, and confidence.

    Returns
    -------
    float
        (1 - confidence) n / (n + n0), with n0 the runs without failure that decide at a single look.

    Notes
    -----
    The function depends on neither the planned nor the final number of runs, so a campaign may be extended after its
    results have been seen.
    """
    return (1.0 - confidence) * runs / (runs + runs_needed(0, probability, confidence))


def _edges(side: int, probability: float, confidence: float, block: int) -> Iterator[int]:
    """Yield, look by look, the number of failures up to which (side 0) or from which (side 1) the test decides.

    Parameters
    ----------
    side : {0, 1}
        Side of the test: met or violated.
    probability, confidence : float
        Required probability of success, and confidence.
    block : int
        Runs between looks.

    Notes
    -----
    If the probability of success is exactly the required value, the number of failures in n runs is binomial. The
    edge of side 0 is the largest number such that the probability of having been at or below an edge, at this look or
    before, is at most that of `error_spending`. If the truth is worse, this probability is smaller still. Side 1 is the
    mirror image and shows a violation. Each side is valid whether or not the campaign stops at the other.
    """
    step: Floats = stats.binom.pmf(np.arange(block + 1), block, 1.0 - probability)
    first = 0
    mass = np.ones(1)  # probabilities of `first`, first + 1, ... failures without a decision so far
    spent_probability = 0.0
    for runs in count(block, block):
        mass = np.convolve(mass, step)
        tail_probability = np.cumsum(mass if side == 0 else mass[::-1])
        allowed_probability = error_spending(runs, probability, confidence) - spent_probability
        # at least one number of failures stays undecided
        crossing = min(int(np.searchsorted(tail_probability, allowed_probability, side="right")), len(mass) - 1)
        spent_probability += float(tail_probability[crossing - 1]) if crossing else 0.0
        if side == 0:
            yield first + crossing - 1
            first = first + crossing
            mass = mass[crossing:]
        else:
            yield first + len(mass) - crossing
            mass = mass[: len(mass) - crossing]
        relevant = np.flatnonzero(mass > _NEGLIGIBLE)
        if len(relevant):  # negligible probabilities are dropped and counted as spent, which is on the safe side
            trimmed_mass = mass[relevant[0] : relevant[-1] + 1]
            spent_probability += float(mass.sum() - trimmed_mass.sum())
            first += int(relevant[0])
            mass = trimmed_mass


@lru_cache(maxsize=128)
def _cached_edges(side: int, probability: float, confidence: float, block: int) -> tuple[list[int], Iterator[int]]:
    """Return a list for the edges computed so far, which `_edge` extends, and the iterator over the next ones."""
    return [], _edges(side, probability, confidence, block)


def _edge(side: int, look: int, probability: float, confidence: float, block: int) -> int:
    """Return the edge of a side at a look (from 0), see `_edges`.

    Parameters
    ----------
    side : {0, 1}
        Side of the test: met or violated.
    look : int
        Number of the look, from 0.
    probability, confidence : float
        Required probability of success, and confidence.
    block : int
        Runs between looks.
    """
    edges, next_edges = _cached_edges(side, probability, confidence, block)
    n_missing = max(0, look + 1 - len(edges))
    edges.extend(islice(next_edges, n_missing))
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
    low = [_edge(0, look, probability, confidence, block) for look in range(looks)]
    high = [_edge(1, look, probability, confidence, block) for look in range(looks)]
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
    for look, failure_count in enumerate(failures):
        if failure_count <= low[look]:
            return "met", (look + 1) * block
        if failure_count >= high[look]:
            return "violated", (look + 1) * block
    return "undecided", len(failures) * block


def further_runs(failures: Sequence[int], probability: float, confidence: float, block: int) -> int:
    """Return the number of further runs without failure after which an undecided requirement would be met.

    Parameters
    ----------
    failures : (n_look,) sequence of int
        Cumulative number of failures at each look so far.
    probability, confidence : float
        Required probability of success, and confidence.
    block : int
        Runs between looks.
    """
    n_failed = failures[-1] if len(failures) else 0
    look = len(failures)
    while look < _FURTHEST and n_failed > _edge(0, look, probability, confidence, block):
        look += 1
    further_looks = min(look + 1, _FURTHEST) - len(failures)
    return further_looks * block
