"""Result tables to tidy frames, each by name in `METRICS`: what a report shows and what lies with it as CSV."""

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
    """Return a metric of tables that takes a results folder too, and is computed once."""
    computed = once(metric)

    @wraps(metric)
    def of_results(results: Path | str | Tables) -> pd.DataFrame:
        return computed(load(results))

    return of_results


# The metrics of each module that have the names of their functions
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
# Every metric by name; each takes a results folder, or its tables, and returns a tidy frame.
METRICS: dict[str, Callable[[Path | str | Tables], pd.DataFrame]] = {
    "requirements": _of_results(confirmation.verdicts),
    "corridor": _of_results(impact.corridor_verdicts),
    **{name: _of_results(getattr(module, name)) for module, names in _NAMED.items() for name in names},
}

# The metrics that stand beside a report as CSV, with the columns that users and their CI rely on.
CSV = (
    "rms", "agreement", "controlled", "references", "requirements", "windows", "filter_verdicts", "budget", "expected",
    "spot_check", "sensitivity", "orbit", "correction", "impact", "corridor", "transitions", "logic", "integrity",
    "tested_errors", "curves", "crossings", "tornado", "designs", "effects", "swings", "regions", "totals", "pareto",
    "motion", "nozzle", "turning", "allan",
    "protection", "exclusions", "assumptions", "configuration", "injection",
    "injection_sources", "cutoff", "lost",
)  # fmt: skip
