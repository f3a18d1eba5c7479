"""Metrics: result tables to tidy frames, each by name in `METRICS`. Read `errors/rms.py` first, then `requirements`."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path

import pandas as pd

from lvnav_trade.metrics.errors.covariances import (
    agreement,
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
from lvnav_trade.metrics.requirements.confirmation import expected, improvements, spot_check, verdicts
from lvnav_trade.metrics.signals import in_view, losses, outages, recovery, tracking, transitions
from lvnav_trade.metrics.vehicle import motion, nozzle, turning, worth
from lvnav_trade.store.read import Tables, load


def _of_results(metric: Callable[[Tables], pd.DataFrame]) -> Callable[[Path | str | Tables], pd.DataFrame]:
    """Return a metric of tables that takes a results folder too."""

    @wraps(metric)
    def of_results(results: Path | str | Tables) -> pd.DataFrame:
        return metric(load(results))

    return of_results


# Every metric by name; each takes a results folder, or its tables, and returns a tidy frame.
METRICS: dict[str, Callable[[Path | str | Tables], pd.DataFrame]] = {
    "rms": _of_results(rms),
    "agreement": _of_results(agreement),
    "controlled": _of_results(controlled),
    "requirements": _of_results(verdicts),
    "references": _of_results(references),
    "ranking": _of_results(ranking),
    "consistency": _of_results(consistency),
    "nees": _of_results(nees),
    "nis": _of_results(nis),
    "whiteness": _of_results(whiteness),
    "autocorrelation": _of_results(autocorrelation),
    "in_view": _of_results(in_view),
    "outages": _of_results(outages),
    "tracking": _of_results(tracking),
    "losses": _of_results(losses),
    "recovery": _of_results(recovery),
    "transitions": _of_results(transitions),
    "logic": _of_results(logic),
    "modes": _of_results(modes),
    "stops": _of_results(stops),
    "budget": _of_results(budget),
    "expected": _of_results(expected),
    "spot_check": _of_results(spot_check),
    "improvements": _of_results(improvements),
    "contributions": _of_results(contributions),
    "sensitivity": _of_results(sensitivity),
    "observability": _of_results(observability),
    "nonlinearity": _of_results(nonlinearity),
    "orbit": _of_results(orbit),
    "correction": _of_results(correction),
    "impact": _of_results(impact),
    "corridor": _of_results(corridor_verdicts),
    "motion": _of_results(motion),
    "nozzle": _of_results(nozzle),
    "observed": _of_results(observed),
    "turning": _of_results(turning),
    "worth": _of_results(worth),
    "interpretations": _of_results(interpretations),
}

# The metrics that stand beside a report as CSV, with the columns that users and their CI rely on.
CSV = (
    "rms", "agreement", "controlled", "references", "requirements", "budget", "expected", "spot_check", "sensitivity",
    "orbit", "correction", "impact", "corridor", "transitions", "logic", "motion", "nozzle", "turning",
)  # fmt: skip
