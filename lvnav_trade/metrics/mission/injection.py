"""Where guided ascents arrive: the achieved orbit against its target, split into knowledge and execution."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.case import Injections
from lvnav_trade.metrics.basics.case_tables import CaseTables
from lvnav_trade.metrics.basics.probability import success_bounds
from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.records import ORBIT, OUTCOMES, Floats
from lvnav_trade.store.read import Tables

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
]
SOURCES = ["case", "quantity", "unit", "source", "sigma", "share_ratio"]
NAVIGATION, TOGETHER, FLOWN = "navigation", "root sum of squares", "runs, all together"
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
]
LABELS = {"m": ("km", 1e-3), "rad": ("deg", 180.0 / np.pi), "dimensionless": ("-", 1.0)}
_CONFIDENCE = 0.95


def injections_of(tables: Tables, case: str) -> dict[str, tuple[str, Injections]]:
    """Return unit and runs of each number of the orbit of a case; empty without guidance."""
    found, known = CaseTables(tables, case), {}
    for quantity in ORBIT:
        one = found.injections(quantity)
        if one is not None:
            rows = tables.injections
            known[quantity] = (str(rows.unit[rows.quantity == quantity].iloc[0]), one)
    return known


def injection(tables: Tables) -> pd.DataFrame:
    """Return the injection accuracy of each guided case: achieved less target, osculating, of runs that reach their
    cut-off.

    The error is knowledge (achieved less navigated) plus execution (navigated less target). Both are correlated: their
    variances do not add. q997: 99.7 % quantile of |error|.
    """
    rows = []
    for case, label in tables.labels.items():
        for quantity, (unit, one) in injections_of(tables, case).items():
            name, factor = LABELS[unit]
            error, knowledge = (part[one.injected] * factor for part in (one.error, one.knowledge))
            if error.size:
                rows.append((label, quantity, name, error.size, *_split(error, knowledge)))
    return pd.DataFrame(rows, columns=INJECTION)


def _split(error: Floats, knowledge: Floats) -> tuple[float, ...]:
    """Return mean and sigma of an error, sigma of its parts, their correlation, and the quantile of its size."""
    execution = error - knowledge
    sigmas = [float(part.std(ddof=1)) if part.size > 1 else np.nan for part in (error, knowledge, execution)]
    both = sigmas[1] * sigmas[2]
    together = float(np.cov(knowledge, execution)[0, 1]) / both if error.size > 1 and both > 0.0 else np.nan
    return float(error.mean()), *sigmas, together, float(np.quantile(np.abs(error), 0.997))


def injection_sources(tables: Tables) -> pd.DataFrame:
    """Return what one sigma of the achieved orbit is made of, source by source, largest first.

    Navigation: spread of a vehicle as on its card with the navigation errors of the runs. Sources of the vehicle: to
    first order, with a navigation without errors. share_ratio: of the sum of squares. Both are independent, so the root
    of that sum is what linear theory expects of the runs, which stand beside it.
    """
    rows: list[tuple[object, ...]] = []
    for case, label in tables.labels.items():
        of_vehicle = pick(tables.injection_budget, case=case)
        for quantity, (unit, one) in injections_of(tables, case).items():
            name, factor = LABELS[unit]
            mine = of_vehicle[of_vehicle.quantity == quantity]
            if mine.empty or mine.sigma_si.isna().any() or one.injected.sum() < 2:
                continue
            parts = {NAVIGATION: float(one.navigation[one.injected].std(ddof=1))}
            parts |= dict(zip(mine.source, mine.sigma_si.astype(float), strict=True))
            total = float(np.sqrt(sum(sigma**2 for sigma in parts.values())))
            ordered = sorted(parts.items(), key=lambda part: -part[1])
            ends = ((TOGETHER, total), (FLOWN, float(one.error[one.injected].std(ddof=1))))
            for source, sigma in (*ordered, *ends):
                share = (sigma / total) ** 2 if total > 0.0 and source != FLOWN else np.nan
                rows.append((label, quantity, name, source.replace("_", " "), sigma * factor, share))
    return pd.DataFrame(rows, columns=SOURCES)


def cutoff(tables: Tables) -> pd.DataFrame:
    """Return how guided ascents end: how many reach their cut-off, share of depletion with its exact 95 % interval,
    time of the cut-off and propellant left of those that reach it; lost: guidance diverged or the navigation failed.
    """
    rows = []
    for case, label in tables.labels.items():
        for _, one in list(injections_of(tables, case).values())[:1]:
            n, empty = one.outcome.size, int(np.sum(one.outcome == OUTCOMES[1]))
            good = int(one.injected.sum())
            low, high = success_bounds(n, empty, 0.5 + 0.5 * _CONFIDENCE)
            share = (empty / n, 1.0 - high, 1.0 - low)
            at = [_moments(part[one.injected]) for part in (one.t, one.left)]
            least = float(one.left[one.injected].min()) if good else np.nan
            rows.append((label, n, good, empty, n - good - empty, *share, *at[0], *at[1], least))
    return pd.DataFrame(rows, columns=CUTOFF)


def _moments(values: Floats) -> tuple[float, float]:
    if not values.size:
        return np.nan, np.nan
    return float(values.mean()), float(values.std(ddof=1)) if values.size > 1 else np.nan
