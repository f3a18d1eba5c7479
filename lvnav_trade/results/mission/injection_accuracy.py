"""Injection accuracy of guided ascents: achieved orbit against target, split into knowledge and execution."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import INJECTION as NUMBERS
from lvnav_trade.quantities.records import ORBIT, OUTCOMES, Floats, InjectionLaw
from lvnav_trade.results.mechanics.injection_law import APSIDES, apsis_errors, is_curved, share_depleted, why_no_law
from lvnav_trade.results.statistics.case_results import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.tables.read import Tables, pick
from lvnav_trade.results.tables.run_tables import INJECTION_UNITS, ORBIT_UNITS

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
SOURCES = ["case", "quantity", "unit", "source", "source_group", "sigma", "share_ratio"]
TOGETHER, FLOWN = "all sources together", "spread of the runs"
CUTOFF = [
    "case",
    "runs",
    "injected_count",
    "depleted_count",
    "failed_count",
    "depleted_ratio",
    "low_ratio",
    "high_ratio",
    "cutoff_s",
    "cutoff_sigma_s",
    "propellant_left_kg",
    "propellant_left_sigma_kg",
    "propellant_left_minimum_kg",
    "lincov_depleted_ratio",
    "lincov_cutoff_s",
    "lincov_cutoff_sigma_s",
    "lincov_propellant_left_kg",
    "lincov_propellant_left_sigma_kg",
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
    """Return the runs for each orbital quantity of a case; empty without guidance, or without runs."""
    by_quantity = {quantity: CaseTables(tables, case).injections(quantity) for quantity in ORBIT}
    return {quantity: runs for quantity, runs in by_quantity.items() if runs is not None}


def injection(tables: Tables) -> pd.DataFrame:
    """Return the injection accuracy of each guided case: achieved less target, osculating, of runs that reach their
    cut-off, and the same by linear covariance.

    The error is the sum of knowledge (achieved less navigated) and execution (navigated less target). The two are
    correlated, so their variances do not add. Columns:

    q997 : 99.7 % quantile of |error|
    reason : why linear covariance does not describe the quantity

    Near a circular orbit, perigee and apogee are computed from draws of semi-major axis and eccentricity vector.
    """
    rows = []
    for case, label in tables.labels.items():
        runs, law = injections_of(tables, case), CaseTables(tables, case).injection_law()
        for quantity in ORBIT if runs or law is not None else ():
            name, factor = LABELS[ORBIT_UNITS[quantity]]
            statistics = (0, *[np.nan] * 6)
            if quantity in runs and runs[quantity].injected.any():
                runs_of = runs[quantity]
                error, knowledge = (
                    error_of[runs_of.injected] * factor for error_of in (runs_of.error, runs_of.knowledge)
                )
                statistics = (error.size, *_split(error, knowledge))
            rows.append((label, quantity, name, *statistics, *_expected(law, quantity, factor)))
    return pd.DataFrame(rows, columns=INJECTION)


def _expected(law: InjectionLaw | None, quantity: str, factor: float) -> tuple[float | str, ...]:
    """Return mean and sigma by linear covariance, the sigmas of knowledge and execution, and the reason if NaN."""
    reason = "no linear covariance" if law is None else why_no_law(law, (quantity,))
    if law is None or reason:
        return *[np.nan] * 4, reason
    k = ORBIT.index(quantity)
    parts = [float(np.sqrt(contribution[:, k].sum())) * factor for contribution in (law.knowledge, law.execution)]
    if quantity in APSIDES and is_curved(law, quantity):
        drawn = apsis_errors(law, quantity) * factor
        return float(drawn.mean()), float(drawn.std()), np.nan, np.nan, ""
    return float(law.mean[k]) * factor, float(np.sqrt(law.covariance[:, k, k].sum())) * factor, *parts, ""


def _split(error: Floats, knowledge: Floats) -> tuple[float, ...]:
    """Return mean and sigma of an error, the sigmas of both parts, their correlation, and the quantile of its size."""
    execution = error - knowledge
    sigmas = [float(values.std(ddof=1)) if values.size > 1 else np.nan for values in (error, knowledge, execution)]
    product = sigmas[1] * sigmas[2]
    together = float(np.cov(knowledge, execution)[0, 1]) / product if error.size > 1 and product > 0.0 else np.nan
    return float(error.mean()), *sigmas, together, float(np.quantile(np.abs(error), 0.997))


def injection_sources(tables: Tables) -> pd.DataFrame:
    """Return the composition of one sigma of each injection error by linear covariance, largest source first.

    source_group : navigation or vehicle
    share_ratio : share of the sum of squares; all sources are independent, so their squares add

    For comparison, the table has the standard deviation over the runs, in which all sources act together.
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
                origin = "navigation" if source < law.n_navigation else "vehicle"
                share = (sigma[source] / total) ** 2 if total > 0.0 else np.nan
                rows.append((label, quantity, name, law.sources[source], origin, sigma[source] * factor, share))
            rows.append((label, quantity, name, TOGETHER, "", total * factor, 1.0))
            spread = _spread(runs, quantity)
            if np.isfinite(spread):
                rows.append((label, quantity, name, FLOWN, "", spread * factor, np.nan))
    return pd.DataFrame(rows, columns=SOURCES)


def _spread(runs: dict[str, Injections], quantity: str) -> float:
    """Return the standard deviation of an orbital quantity over the runs that reach their cut-off."""
    if not runs:
        return np.nan
    injections = runs.get(quantity, runs[ORBIT[0]])
    values = {"cutoff_time": injections.t, "propellant_left": injections.left}.get(quantity, injections.error)[
        injections.injected
    ]
    return float(values.std(ddof=1)) if values.size > 1 else np.nan


def cutoff(tables: Tables) -> pd.DataFrame:
    """Return how guided ascents end: how many reach their cut-off, share of depletion with its exact 95 % interval,
    time of cut-off and residual propellant of the runs that reach it.

    failed_count : runs with diverged guidance or failed navigation
    """
    rows = []
    for case, label in tables.labels.items():
        law = CaseTables(tables, case).injection_law()
        first_quantity = list(injections_of(tables, case).values())[:1]
        if not first_quantity and law is None:
            continue
        runs: tuple[float, ...] = (0, 0, 0, 0, *[np.nan] * 8)
        for injections in first_quantity:
            n, empty = injections.outcome.size, int(np.sum(injections.outcome == OUTCOMES[1]))
            good = int(injections.injected.sum())
            low, high = success_bounds(n, empty, 0.5 + 0.5 * _CONFIDENCE)
            share = (empty / n, 1.0 - high, 1.0 - low)
            at = [_moments(values[injections.injected]) for values in (injections.t, injections.left)]
            least = float(injections.left[injections.injected].min()) if good else np.nan
            runs = (n, good, empty, n - good - empty, *share, *at[0], *at[1], least)
        rows.append((label, *runs, *_expected_end(law)))
    return pd.DataFrame(rows, columns=CUTOFF)


def _expected_end(law: InjectionLaw | None) -> tuple[float, ...]:
    """Return the probability of depletion, then cut-off time and residual propellant with sigmas, by linear covariance.

    NaN where linear covariance does not apply.
    """
    if law is None or law.why:
        return (np.nan,) * 5
    ends: list[float] = []
    for name in ("cutoff_time", "propellant_left"):
        k = NUMBERS.index(name)
        is_valid = not why_no_law(law, (name,))
        ends += [float(law.mean[k]), float(np.sqrt(law.covariance[:, k, k].sum()))] if is_valid else [np.nan, np.nan]
    return share_depleted(law), *ends


def failed_injections(tables: Tables) -> pd.DataFrame:
    """Return the runs of guided ascents that do not reach their cut-off: how and when they end, and the largest draws
    of their vehicle dispersions in sigmas, by source and number.
    """
    rows = []
    for case, label in tables.labels.items():
        ends = pick(tables.injections, case=case, quantity=ORBIT[0])
        drawn = pick(tables.failed_injection_draws, case=case)
        for run in ends[ends.outcome != OUTCOMES[0]].itertuples():
            draws = drawn[drawn.run_number == run.run_number]
            largest = draws.iloc[np.argsort(-draws.draw_ratio.abs(), kind="stable")[:_SHOWN_DRAWS]]
            texts = [
                f"{draw.source.replace('_', ' ')} {draw.draw_number + 1}: {draw.draw_ratio:+.1f}"
                for draw in largest.itertuples()
            ]
            rows.append((label, run.run_number, run.outcome, float(run.t_s), ", ".join(texts)))
    return pd.DataFrame(rows, columns=LOST)


def _moments(values: Floats) -> tuple[float, float]:
    if not values.size:
        return np.nan, np.nan
    return float(values.mean()), float(values.std(ddof=1)) if values.size > 1 else np.nan
