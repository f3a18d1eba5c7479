"""Metrics: result tables to tidy frames, each by name in `METRICS`. Read `errors/rms.py` first, then `requirements`."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path

import pandas as pd

from lvnav_trade.metrics.errors.covariances import agreement
from lvnav_trade.metrics.errors.diagnostics import (
    budget,
    contributions,
    nonlinearity,
    observability,
    observed,
    sensitivity,
)
from lvnav_trade.metrics.errors.rms import controlled, ranking, rms
from lvnav_trade.metrics.filter import autocorrelation, consistency, logic, modes, nees, nis, stops, whiteness
from lvnav_trade.metrics.mission.impact import corridor_verdicts, impact
from lvnav_trade.metrics.mission.orbit import correction, orbit
from lvnav_trade.metrics.published import interpretations, references
from lvnav_trade.metrics.requirements.improvements import expected, improvements
from lvnav_trade.metrics.requirements.requirements import verdicts
from lvnav_trade.metrics.signals import in_view, losses, outages, recovery, tracking, transitions
from lvnav_trade.metrics.vehicle import motion, nozzle, turning, worth
from lvnav_trade.store import Tables, load


def _of_results(metric: Callable[[Tables], pd.DataFrame]) -> Callable[[Path | str | Tables], pd.DataFrame]:
    """Return a metric of tables that takes a results folder too."""

    @wraps(metric)
    def of_results(results: Path | str | Tables) -> pd.DataFrame:
        return metric(load(results))

    return of_results


_METRICS: dict[str, Callable[[Tables], pd.DataFrame]] = {
    "rms": rms,
    "agreement": agreement,
    "controlled": controlled,
    "requirements": verdicts,
    "references": references,
    "ranking": ranking,
    "consistency": consistency,
    "nees": nees,
    "nis": nis,
    "whiteness": whiteness,
    "autocorrelation": autocorrelation,
    "in_view": in_view,
    "outages": outages,
    "tracking": tracking,
    "losses": losses,
    "recovery": recovery,
    "transitions": transitions,
    "logic": logic,
    "modes": modes,
    "stops": stops,
    "budget": budget,
    "expected": expected,
    "improvements": improvements,
    "contributions": contributions,
    "sensitivity": sensitivity,
    "observability": observability,
    "nonlinearity": nonlinearity,
    "orbit": orbit,
    "correction": correction,
    "impact": impact,
    "corridor": corridor_verdicts,
    "motion": motion,
    "nozzle": nozzle,
    "observed": observed,
    "turning": turning,
    "worth": worth,
    "interpretations": interpretations,
}
METRICS = {name: _of_results(metric) for name, metric in _METRICS.items()}
"""Every metric by name; each takes a results folder, or its tables, and returns a tidy frame."""

CSV = (
    "rms", "agreement", "controlled", "references", "requirements", "budget", "expected", "sensitivity", "orbit",
    "correction", "impact", "corridor", "transitions", "logic", "motion", "nozzle", "turning",
)  # fmt: skip
"""The metrics that stand beside a report as CSV, with the columns that users and their CI rely on."""

__all__ = ["CSV", "METRICS", "agreement", "budget", "rms", "verdicts"]
