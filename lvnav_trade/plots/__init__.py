"""FAMILY 5: results -> figure. Each takes a results folder (or its tables), most of them a case or a quantity too."""

from collections.abc import Callable
from typing import Any

from lvnav_trade.plots.budget import budget, heatmap
from lvnav_trade.plots.errors import autocorrelations, comparison, consistency, envelope, errors, logic, rank, relative
from lvnav_trade.plots.mission import impact, orbit
from lvnav_trade.plots.published import locus, missions, spread
from lvnav_trade.plots.signals import delays, latency, satellites, sky, timeline
from lvnav_trade.plots.validity import validity
from lvnav_trade.plots.vehicle import (
    apart,
    envelopes,
    ignition,
    interpretations,
    motion,
    movement,
    singular,
    sweep,
    trajectory,
    worth,
)

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
    "validity": validity,
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
