"""Computed tables of results by name (`METRICS`): the tables of a report and its CSV files."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.results.evaluation import (
    assumed_numbers,
    covariances,
    coverage,
    design_space,
    designs,
    filter_consistency,
    inertial_units,
    integrity,
    motion_estimates,
    protection_levels,
    published,
    resources,
    rms,
    satellite_tracking,
    tornado,
)
from lvnav_trade.results.mission import impact, injection_accuracy, orbit
from lvnav_trade.results.requirements import confirmation, limit_crossings, margins, windows
from lvnav_trade.results.statistics.select import cache_result
from lvnav_trade.results.tables.read import Tables, load


def _of_results(metric: Callable[[Tables], pd.DataFrame]) -> Callable[[Path | str | Tables], pd.DataFrame]:
    """Return a function of a results folder or its tables that computes a table once and caches it."""
    cached_table = cache_result(metric)

    @wraps(metric)
    def of_results(results: Path | str | Tables) -> pd.DataFrame:
        return cached_table(load(results))

    return of_results


# Tables of each module whose names are those of their functions
_NAMED: dict[Any, tuple[str, ...]] = {
    rms: ("rms", "control_variates", "ranking"),
    coverage: ("coverage",),
    covariances: (
        "agreement",
        "budget",
        "contributions",
        "sensitivity",
        "observability",
        "nonlinearity",
        "observability_ranks",
    ),
    filter_consistency: (
        "consistency",
        "filter_verdicts",
        "nees",
        "nis",
        "whiteness",
        "autocorrelation",
        "mode_transitions",
        "modes",
        "stops",
    ),
    integrity: ("integrity", "decisions", "fault_test_errors"),
    satellite_tracking: ("in_view", "outages", "tracking", "losses", "recovery", "transitions"),
    resources: ("resource_totals", "pareto"),
    designs: ("designs",),
    design_space: ("effects", "regions"),
    tornado: ("swings",),
    assumed_numbers: ("assumptions", "configuration"),
    limit_crossings: ("curves", "crossings", "tornado"),
    confirmation: ("expected_verdicts", "spot_check", "improvements"),
    margins: ("margins",),
    windows: ("windows", "unevaluated"),
    orbit: ("orbit", "orbit_correction", "normality"),
    impact: ("impact",),
    injection_accuracy: ("injection", "injection_sources", "cutoff", "failed_injections"),
    inertial_units: ("allan", "exclusions"),
    protection_levels: ("protection",),
    motion_estimates: ("rate_and_acceleration", "nozzle_travel", "motion_statistics", "rate_filter_benefit"),
    published: ("references",),
}
# Every computed table by name; each function takes a results folder, or its tables, and returns a tidy frame.
METRICS: dict[str, Callable[[Path | str | Tables], pd.DataFrame]] = {
    "requirements": _of_results(confirmation.verdicts),
    "corridor": _of_results(impact.corridor_verdicts),
    **{name: _of_results(getattr(module, name)) for module, names in _NAMED.items() for name in names},
}

# Tables written as CSV next to a report. Their columns are an interface for users and their automated checks.
CSV = (
    "rms", "agreement", "control_variates", "references", "requirements", "windows", "filter_verdicts", "budget",
    "expected_verdicts", "spot_check", "sensitivity", "orbit", "orbit_correction", "impact", "corridor", "transitions",
    "mode_transitions", "integrity", "fault_test_errors", "curves", "crossings", "tornado", "designs", "effects",
    "swings", "regions", "resource_totals", "pareto", "rate_and_acceleration", "nozzle_travel", "motion_statistics",
    "allan", "protection", "exclusions", "assumptions", "configuration", "injection", "injection_sources", "cutoff",
    "failed_injections",
)  # fmt: skip
