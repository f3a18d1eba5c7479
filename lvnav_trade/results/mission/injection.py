"""Where guided ascents arrive: the achieved orbit against its target, split into knowledge and execution."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import INJECTION as NUMBERS
from lvnav_trade.quantities.records import ORBIT, OUTCOMES, Floats, InjectionLaw
from lvnav_trade.results.mechanics.injection import APSIDES, apsis_errors, is_curved, share_depleted, why_no_law
from lvnav_trade.results.statistics.case import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.tables.read import Tables, pick
from lvnav_trade.results.tables.runs import INJECTION_UNITS, ORBIT_UNITS

INJECTION = [
    "case",
    "quantity",
    "unit",
    "runs",
    "mean_error",
    "sigma",
    "knowledge_sigma",
    "execution_sigma",
    "correlation_ratio",
    "q997",
    "lincov_mean",
    "lincov_sigma",
    "lincov_knowledge_sigma",
    "lincov_execution_sigma",
    "reason",
]
SOURCES = ["case", "quantity", "unit", "source", "part", "sigma", "share_ratio"]
TOGETHER, FLOWN = "all sources together", "spread of the runs"
CUTOFF = [
    "case",
    "runs",
    "injected_count",
    "depleted_count",
    "lost_count",
    "depleted_ratio",
    "low_ratio",
    "high_ratio",
    "cutoff_s",
    "cutoff_sigma_s",
    "left_kg",
    "left_sigma_kg",
    "left_least_kg",
    "lincov_depleted_ratio",
    "lincov_cutoff_s",
    "lincov_cutoff_sigma_s",
    "lincov_left_kg",
    "lincov_left_sigma_kg",
]
LOST = ["case", "run_number", "outcome", "t_s", "draws"]
_SHOWN_DRAWS = 4
LABELS = {
    "m": ("km", 1e-3),
    "rad": ("deg", 180.0 / np.pi),
    "dimensionless": ("-", 1.0),
    "s": ("s", 1.0),
    "kg": ("kg", 1.0),
}
_CONFIDENCE = 0.95


def injections_of(tables: Tables, case: str) -> dict[str, Injections]:
    """Return the runs of each number of the orbit of a case; empty without guidance, or runs."""
    found = {quantity: CaseTables(tables, case).injections(quantity) for quantity in ORBIT}
    return {quantity: one for quantity, one in found.items() if one is not None}


def injection(tables: Tables) -> pd.DataFrame:
    """Return the injection accuracy of each guided case: achieved less target, osculating, of runs that reach their
    cut-off, and the same by linear covariance.

    The error is knowledge (achieved less navigated) plus execution (navigated less target). Both are correlated: their
    variances do not add. q997: 99.7 % quantile of |error|. reason: why linear covariance does not hold the number.
    Perigee and apogee near a circle are those of draws of its axis and eccentricity vector.
    """
    rows = []
    for case, label in tables.labels.items():
        runs, law = injections_of(tables, case), CaseTables(tables, case).injection_law()
        for quantity in ORBIT if runs or law is not None else ():
            name, factor = LABELS[ORBIT_UNITS[quantity]]
            flown = (0, *[np.nan] * 6)
            if quantity in runs and runs[quantity].injected.any():
                one = runs[quantity]
                error, knowledge = (part[one.injected] * factor for part in (one.error, one.knowledge))
                flown = (error.size, *_split(error, knowledge))
            rows.append((label, quantity, name, *flown, *_expected(law, quantity, factor)))
    return pd.DataFrame(rows, columns=INJECTION)


def _expected(law: InjectionLaw | None, quantity: str, factor: float) -> tuple[float | str, ...]:
    """Return mean and sigma by linear covariance, sigma of the two parts, and why there are none."""
    reason = "no linear covariance" if law is None else why_no_law(law, (quantity,))
    if law is None or reason:
        return *[np.nan] * 4, reason
    k = ORBIT.index(quantity)
    parts = [float(np.sqrt(part[:, k].sum())) * factor for part in (law.knowledge, law.execution)]
    if quantity in APSIDES and is_curved(law, quantity):
        drawn = apsis_errors(law, quantity) * factor
        return float(drawn.mean()), float(drawn.std()), np.nan, np.nan, ""
    return float(law.mean[k]) * factor, float(np.sqrt(law.covariance[:, k, k].sum())) * factor, *parts, ""


def _split(error: Floats, knowledge: Floats) -> tuple[float, ...]:
    """Return mean and sigma of an error, sigma of its parts, their correlation, and the quantile of its size."""
    execution = error - knowledge
    sigmas = [float(part.std(ddof=1)) if part.size > 1 else np.nan for part in (error, knowledge, execution)]
    both = sigmas[1] * sigmas[2]
    together = float(np.cov(knowledge, execution)[0, 1]) / both if error.size > 1 and both > 0.0 else np.nan
    return float(error.mean()), *sigmas, together, float(np.quantile(np.abs(error), 0.997))


def injection_sources(tables: Tables) -> pd.DataFrame:
    """Return what one sigma of each number of an injection is made of by linear covariance, largest source first.

    part: navigation or vehicle. All sources are independent, so that their squares add. share_ratio: of that sum.
    Beside it stands the spread of the runs, in which all sources act together.
    """
    rows: list[tuple[object, ...]] = []
    for case, label in tables.labels.items():
        runs, law = injections_of(tables, case), CaseTables(tables, case).injection_law()
        for k, quantity in enumerate(NUMBERS):
            sigma = np.zeros(0)
            if law is not None and not why_no_law(law, (quantity,)):
                sigma = np.sqrt(law.covariance[:, k, k])
            if law is None or not sigma.size or not np.all(np.isfinite(sigma)):
                continue
            name, factor = LABELS[INJECTION_UNITS[quantity]]
            total = float(np.sqrt(np.sum(sigma**2)))
            for source in np.argsort(-sigma, kind="stable").tolist():
                part = "navigation" if source < law.n_navigation else "vehicle"
                share = (sigma[source] / total) ** 2 if total > 0.0 else np.nan
                rows.append((label, quantity, name, law.sources[source], part, sigma[source] * factor, share))
            rows.append((label, quantity, name, TOGETHER, "", total * factor, 1.0))
            spread = _spread(runs, quantity)
            if np.isfinite(spread):
                rows.append((label, quantity, name, FLOWN, "", spread * factor, np.nan))
    return pd.DataFrame(rows, columns=SOURCES)


def _spread(runs: dict[str, Injections], quantity: str) -> float:
    """Return the standard deviation of a number of the injection over the runs that reach their cut-off."""
    if not runs:
        return np.nan
    one = runs.get(quantity, runs[ORBIT[0]])
    values = {"cutoff_time": one.t, "propellant_left": one.left}.get(quantity, one.error)[one.injected]
    return float(values.std(ddof=1)) if values.size > 1 else np.nan


def cutoff(tables: Tables) -> pd.DataFrame:
    """Return how guided ascents end: how many reach their cut-off, share of depletion with its exact 95 % interval,
    time of the cut-off and propellant left of those that reach it; lost: guidance diverged or the navigation failed.
    """
    rows = []
    for case, label in tables.labels.items():
        law = CaseTables(tables, case).injection_law()
        flown = list(injections_of(tables, case).values())[:1]
        if not flown and law is None:
            continue
        runs: tuple[float, ...] = (0, 0, 0, 0, *[np.nan] * 8)
        for one in flown:
            n, empty = one.outcome.size, int(np.sum(one.outcome == OUTCOMES[1]))
            good = int(one.injected.sum())
            low, high = success_bounds(n, empty, 0.5 + 0.5 * _CONFIDENCE)
            share = (empty / n, 1.0 - high, 1.0 - low)
            at = [_moments(part[one.injected]) for part in (one.t, one.left)]
            least = float(one.left[one.injected].min()) if good else np.nan
            runs = (n, good, empty, n - good - empty, *share, *at[0], *at[1], least)
        rows.append((label, *runs, *_expected_end(law)))
    return pd.DataFrame(rows, columns=CUTOFF)


def _expected_end(law: InjectionLaw | None) -> tuple[float, ...]:
    """Return share of depletion, then time of cut-off and propellant left, each with its sigma, by linear covariance;
    NaN where that does not hold.
    """
    if law is None or law.why:
        return (np.nan,) * 5
    ends: list[float] = []
    for name in ("cutoff_time", "propellant_left"):
        k = NUMBERS.index(name)
        known = not why_no_law(law, (name,))
        ends += [float(law.mean[k]), float(np.sqrt(law.covariance[:, k, k].sum()))] if known else [np.nan, np.nan]
    return share_depleted(law), *ends


def lost(tables: Tables) -> pd.DataFrame:
    """Return the runs of guided ascents that do not reach their cut-off: how and when they end, and the largest draws
    of their vehicle in sigmas, by source and number.
    """
    rows = []
    for case, label in tables.labels.items():
        ends = pick(tables.injections, case=case, quantity=ORBIT[0])
        drawn = pick(tables.lost_vehicles, case=case)
        for run in ends[ends.outcome != OUTCOMES[0]].itertuples():
            mine = drawn[drawn.run_number == run.run_number]
            largest = mine.iloc[np.argsort(-mine.draw_ratio.abs(), kind="stable")[:_SHOWN_DRAWS]]
            named = [
                f"{one.source.replace('_', ' ')} {one.draw_number + 1}: {one.draw_ratio:+.1f}"
                for one in largest.itertuples()
            ]
            rows.append((label, run.run_number, run.outcome, float(run.t_s), ", ".join(named)))
    return pd.DataFrame(rows, columns=LOST)


def _moments(values: Floats) -> tuple[float, float]:
    if not values.size:
        return np.nan, np.nan
    return float(values.mean()), float(values.std(ddof=1)) if values.size > 1 else np.nan
