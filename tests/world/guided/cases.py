"""Guided ascents for the tests of this folder."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from lvnav_trade.world.ascent.vehicle import VehicleAscent
from lvnav_trade.world.guided.dynamics import Navigation
from lvnav_trade.world.guided.reference import Plan, plan_of
from tests.world.flights import launcher_settings


def guided(name: str = "two_stage_leo", **changes: Any) -> VehicleAscent:
    """Return a shipped ascent under guidance, explicit unless said otherwise."""
    return VehicleAscent.model_validate({**launcher_settings(name), "guidance": "explicit", **changes})


@cache
def plan(name: str = "two_stage_leo", guidance: str = "explicit", cutoff: str = "energy") -> Plan:
    """Return the plan of a shipped ascent whose runs draw all spreads."""
    return plan_of(guided(name, guidance=guidance, cutoff=cutoff, dispersion={"draw": "all"}))


def constant_error(*, attitude: Any = (0, 0, 0), velocity: Any = (0, 0, 0), position: Any = (0, 0, 0)) -> Navigation:
    """Return navigation errors that last, frame i, as they are known once a second."""
    error, t = np.concatenate([attitude, velocity, position]).astype(float), np.arange(-60.0, 601.0)
    return Navigation(t, np.tile(error, (t.size, 1)))
