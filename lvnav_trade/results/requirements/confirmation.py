"""Spot check of linear covariance by a few runs of each case; its verdicts do not count if they disagree."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, ncx2

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.metric import where
from lvnav_trade.results.requirements import improvements as by_covariance
from lvnav_trade.results.requirements import requirements as by_runs
from lvnav_trade.results.statistics.select import NAVIGATION, history_of, once, pick
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "event",
    "t_s",
    "error",
    "runs",
    "unit",
    "expected",
    "found",
    "ratio",
    "chance_ratio",
    "verdict",
]
# Probability that any row of a campaign disagrees by chance, with both engines describing the same errors
ALPHA = 0.01
# Predicted fraction of runs beyond the tested quantile
TAIL = 1e-3
NOT_CONFIRMED = "not confirmed"


@once
def spot_check(tables: Tables) -> pd.DataFrame:
    """Return the comparison of the runs of the spot check with linear covariance; empty if there is no spot check.

    There are two kinds of rows. Navigation errors, at every event and at the first measurement after every gap: RMS of
    the runs over that of linear covariance; the p-value is of a noncentral chi-square distribution. Errors of
    requirements: number of runs beyond the predicted 99.9 % quantile, over the expected number; the p-value is
    binomial.

    verdict: "disagree" if the p-value is below 1 % divided by the number of rows of the campaign (Bonferroni),
    otherwise "agree"; "not applicable" if a gate or a mode logic makes linear covariance inapplicable to the case.
    """
    spot = tables.with_frames(runs=tables.spot_runs)
    checked = list(tables.labels) if len(spot.runs) else []
    rows = [row for case in checked for row in (*_sizes(spot, case), *_tails(spot, case))]
    frame = pd.DataFrame(rows, columns=COLUMNS[:-1])
    applies = ~frame.case.isin({label for case, label in tables.labels.items() if why_not_applicable(tables, case)})
    agree = np.where(frame.chance_ratio < ALPHA / max(1, int(applies.sum())), "disagree", "agree")
    return frame.assign(verdict=np.where(applies, agree, "not applicable"))


def _sizes(flown: Tables, case: str) -> list[tuple[Any, ...]]:
    """Return the rows of the navigation errors of a case."""
    heads, numbers = [], []
    runs = _by_event(pick(flown.runs, case=case))
    for quantity, axis in ((q, a) for q, a in flown.people if q in NAVIGATION and a != "3d"):
        history = history_of(flown, case, quantity, axis)
        t, sigmas, means = (history[name].to_numpy() for name in ("t_s", "lincov_true_si", "lincov_mean_si"))
        unit, factor = flown.people[quantity, axis]
        for event, (moment, columns) in runs.items() if len(history) else ():
            at = int(np.argmin(np.abs(t - moment)))
            errors = columns.get(f"{quantity}_{axis}")
            if sigmas[at] > 0.0 and errors is not None:
                rms = float(np.sqrt(np.mean(errors**2))) if np.isfinite(errors).all() else np.inf  # a run failed
                heads.append((flown.labels[case], event, moment, f"{quantity} {axis}", len(errors), unit))
                numbers.append((len(errors), sigmas[at], means[at], rms, factor))
    n, sigma, mean, found_rms, scale = np.array(numbers, dtype=float).reshape(-1, 5).T
    law, expected = ncx2(n, n * (mean / sigma) ** 2), np.hypot(sigma, mean)
    size = n * (found_rms / sigma) ** 2
    chance = 2.0 * np.minimum(law.cdf(size), law.sf(size))
    found = np.stack([expected * scale, found_rms * scale, found_rms / expected, chance], axis=1)
    return [(*head, *map(float, values)) for head, values in zip(heads, found, strict=True)]


def _by_event(rows: pd.DataFrame) -> dict[str, tuple[float, dict[str, Floats]]]:
    """Return the time (s) of every event of a case and the errors (n,) of its runs there, by quantity and axis."""
    columns = {"_".join(name.split("_")[:2]): rows[name].to_numpy(dtype=float) for name in rows if "_error_" in name}
    t, events = rows.t_s.to_numpy(), rows.groupby("event", sort=False).indices
    return {
        str(event): (float(t[at[0]]), {name: of[at] for name, of in columns.items()}) for event, at in events.items()
    }


def _tails(flown: Tables, case: str) -> list[tuple[Any, ...]]:
    """Return the rows of the requirements of a case, without phases, for which linear covariance gives a bound only."""
    found = []
    for requirement in flown.campaign.get("requirements") or ():
        law, event = by_covariance.asked(flown, requirement, case), where(requirement)
        runs = None if requirement.get("during") else by_runs.errors_of(flown, case, requirement)
        if isinstance(law, str) or runs is None or not runs.size.size:
            continue
        n, limit = runs.size.size, law.quantile(1.0 - TAIL)
        beyond = int((runs.size > limit).sum())
        name = f"{requirement['name']}, runs beyond the 99.9 % quantile"
        t = float(pick(flown.runs, case=case, event=event).t_s.iloc[0])
        chance = float(binom.sf(beyond - 1, n, TAIL))
        found.append((flown.labels[case], event, t, name, n, "", n * TAIL, beyond, beyond / (n * TAIL), chance))
    return found


def unconfirmed(tables: Tables) -> dict[str, str]:
    """Return the reason why linear covariance is not confirmed, by label of the case: its least likely row in words."""
    frame = spot_check(tables)
    rows = frame[frame.verdict == "disagree"].sort_values("chance_ratio", kind="stable").drop_duplicates("case")
    return {row.case: _in_words(row) for row in rows.itertuples()}


def _in_words(row: Any) -> str:
    moment = row.event if " at " in row.event else f"at {row.event.replace('_', ' ')}"
    if row.unit:
        what = f"{row.error} is {row.ratio:.3g} times what linear covariance predicts"
    else:
        what = f"{row.error}: {row.found:g} of {row.runs}, {row.expected:.2g} expected"
    return f"spot check of {row.runs} runs, {moment}: {what}"


@once
def verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdict on every requirement in every case, with its method in the column `by`.

    by "runs": the verdict of `requirements.verdicts`, or "not confirmed" if the runs are undecided and the spot check
    disagrees with linear covariance. by "LinCov": verdict, estimate, limit and unit of `expected_verdicts`, for cases
    without runs, and for cases that are not selected for a demonstration (``monte_carlo.selected``) and undecided by
    their runs.
    """
    frame, alone, why = by_runs.verdicts(tables), expected_verdicts(tables), unconfirmed(tables)
    not_confirmed = (frame.verdict == "undecided") & frame.case.isin(why)
    frame = frame.assign(verdict=frame.verdict.mask(not_confirmed, NOT_CONFIRMED), by="runs")
    both = frame[["requirement", "case"]].merge(alone, on=["requirement", "case"], how="left").set_index(frame.index)
    others = frame.case.isin(by_runs.unselected(tables)) & (frame.verdict == "undecided")
    taken = both.verdict.notna() & ((frame.runs == 0) | (others & both.verdict.isin(["met", "violated"])))
    for name in ("verdict", "estimate", "limit", "unit"):
        frame[name] = frame[name].mask(taken, both[name])
    return frame.assign(unit=frame.unit.fillna(""), by=frame.by.mask(taken, "LinCov"))


def expected_verdicts(tables: Tables) -> pd.DataFrame:
    """Return the verdicts by linear covariance, "not confirmed" with the reason if the spot check disagrees.

    Otherwise they are those of `improvements.expected`.
    """
    frame, why = by_covariance.expected(tables), unconfirmed(tables)
    refuted = frame.verdict.isin(["met", "violated"]) & frame.case.isin(why)
    reason = frame.reason.mask(refuted, frame.case.map(why))
    return frame.assign(verdict=frame.verdict.mask(refuted, NOT_CONFIRMED), reason=reason)


def improvements(tables: Tables) -> pd.DataFrame:
    """Return the improvements by linear covariance that would meet requirements.

    Cases that meet the requirement and cases whose spot check disagrees are omitted.
    """
    frame, found = by_covariance.improvements(tables), verdicts(tables)
    met = set(found[found.verdict == "met"][["requirement", "case"]].itertuples(index=False, name=None))
    done = [(row.requirement, row.case) in met for row in frame.itertuples()]
    return frame[~frame.case.isin(unconfirmed(tables)) & ~np.array(done, dtype=bool)].reset_index(drop=True)
