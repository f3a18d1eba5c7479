"""FAMILY 5: results -> figure. Each takes a results folder (or its tables), most of them a case or a quantity too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lvnav_trade.plots.budget import budget, heatmap
from lvnav_trade.plots.case_errors import autocorrelations, errors, relative
from lvnav_trade.plots.consistency import consistency
from lvnav_trade.plots.delays import delays, latency
from lvnav_trade.plots.errors import comparison, envelope, rank
from lvnav_trade.plots.flight import trajectory
from lvnav_trade.plots.impact import impact
from lvnav_trade.plots.logic import logic
from lvnav_trade.plots.missions import missions
from lvnav_trade.plots.motion import apart, ignition, interpretations, motion, singular
from lvnav_trade.plots.nozzle import envelopes, movement, sweep, worth
from lvnav_trade.plots.orbit import orbit
from lvnav_trade.plots.published import locus, spread
from lvnav_trade.plots.sky import satellites, sky
from lvnav_trade.plots.timeline import timeline

PLOTS: dict[str, Callable[..., Any]] = {
    "trajectory": trajectory,
    "satellites": satellites,
    "sky": sky,
    "timeline": timeline,
    "logic": logic,
    "delays": delays,
    "latency": latency,
    "envelope": envelope,
    "errors": errors,
    "relative": relative,
    "autocorrelation": autocorrelations,
    "locus": locus,
    "spread": spread,
    "comparison": comparison,
    "rank": rank,
    "budget": budget,
    "heatmap": heatmap,
    "consistency": consistency,
    "motion": motion,
    "ignition": ignition,
    "singular": singular,
    "movement": movement,
    "sweep": sweep,
    "turning": envelopes,
    "worth": worth,
    "interpretations": interpretations,
    "apart": apart,
    "orbit": orbit,
    "missions": missions,
    "impact": impact,
}
"""Every figure by name."""

__all__ = ["PLOTS"]
