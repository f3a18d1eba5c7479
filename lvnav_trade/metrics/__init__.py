"""FAMILY 4: Results -> tidy frame (rms, agreement, consistency, whiteness, requirements, references, ...)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from lvnav_trade.metrics.agreement import agreement
from lvnav_trade.metrics.budget import budget
from lvnav_trade.metrics.consistency import consistency, nees, nis
from lvnav_trade.metrics.control import controlled
from lvnav_trade.metrics.correction import correction
from lvnav_trade.metrics.explained import contributions, nonlinearity, observability, sensitivity
from lvnav_trade.metrics.impact import corridor_verdicts, impact
from lvnav_trade.metrics.levers import expected, levers
from lvnav_trade.metrics.logic import logic, modes, stops
from lvnav_trade.metrics.motion import motion
from lvnav_trade.metrics.nozzle import nozzle, turning, worth
from lvnav_trade.metrics.observed import observed
from lvnav_trade.metrics.orbit import orbit
from lvnav_trade.metrics.ranking import ranking
from lvnav_trade.metrics.readings import readings
from lvnav_trade.metrics.references import references
from lvnav_trade.metrics.requirements import verdicts
from lvnav_trade.metrics.rms import rms
from lvnav_trade.metrics.satellites import in_view, outages
from lvnav_trade.metrics.tracking import losses, recovery, tracking, transitions
from lvnav_trade.metrics.whiteness import autocorrelation, whiteness
from lvnav_trade.store import Tables

METRICS: dict[str, Callable[[Path | str | Tables], pd.DataFrame]] = {
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
    "levers": levers,
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
    "readings": readings,
}
"""Every metric by name; each takes a results folder, or its tables, and returns a tidy frame."""

CSV = (
    "rms", "agreement", "controlled", "references", "requirements", "budget", "expected", "sensitivity", "orbit",
    "correction", "impact", "corridor", "transitions", "logic", "motion", "nozzle", "turning",
)  # fmt: skip
"""The metrics that stand beside a report as CSV, with the columns that users and their CI rely on."""

__all__ = ["CSV", "METRICS", "agreement", "budget", "rms", "verdicts"]
