"""Computed tables of results by name (`METRICS`): the tables of a report and its CSV files."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.metrics import (
    assumptions,
    configuration,
    designs,
    filter,
    inertial,
    integrity,
    protection,
    published,
    resources,
    signals,
    space,
    swings,
    vehicle,
)
from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.errors import covariances, coverage, rms
from lvnav_trade.metrics.mission import impact, injection, orbit
from lvnav_trade.metrics.requirements import confirmation, margins, windows
from lvnav_trade.metrics.requirements import curves as along
from lvnav_trade.store.read import Tables, load


def _of_results(metric: Callable[[Tables], pd.DataFrame]) -> Callable[[Path | str | Tables], pd.DataFrame]:
    """Return a function of a results folder or its tables that computes a table once and caches it."""
    computed = once(metric)

    @wraps(metric)
    def of_results(results: Path | str | Tables) -> pd.DataFrame:
        return computed(load(results))

    return of_results


# Tables of each module whose names are those of their functions
_NAMED: dict[Any, tuple[str, ...]] = {
    rms: ("rms", "controlled", "ranking"),
    coverage: ("coverage",),
    covariances: ("agreement", "budget", "contributions", "sensitivity", "observability", "nonlinearity", "observed"),
    filter: (
        "consistency",
        "filter_verdicts",
        "nees",
        "nis",
        "whiteness",
        "autocorrelation",
        "logic",
        "modes",
        "stops",
    ),
    integrity: ("integrity", "decisions", "tested_errors"),
    signals: ("in_view", "outages", "tracking", "losses", "recovery", "transitions"),
    resources: ("totals", "pareto"),
    designs: ("designs",),
    space: ("effects", "regions"),
    swings: ("swings",),
    assumptions: ("assumptions",),
    configuration: ("configuration",),
    along: ("curves", "crossings", "tornado"),
    confirmation: ("expected", "spot_check", "improvements"),
    margins: ("margins",),
    windows: ("windows", "unevaluated"),
    orbit: ("orbit", "correction", "normality"),
    impact: ("impact",),
    injection: ("injection", "injection_sources", "cutoff", "lost"),
    inertial: ("allan", "exclusions"),
    protection: ("protection",),
    vehicle: ("motion", "nozzle", "turning", "worth"),
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
    "rms", "agreement", "controlled", "references", "requirements", "windows", "filter_verdicts", "budget", "expected",
    "spot_check", "sensitivity", "orbit", "correction", "impact", "corridor", "transitions", "logic", "integrity",
    "tested_errors", "curves", "crossings", "tornado", "designs", "effects", "swings", "regions", "totals", "pareto",
    "motion", "nozzle", "turning", "allan",
    "protection", "exclusions", "assumptions", "configuration", "injection",
    "injection_sources", "cutoff", "lost",
)  # fmt: skip
