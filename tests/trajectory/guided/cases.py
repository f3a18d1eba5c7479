"""Guided ascents for the tests of this folder."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from lvnav_trade.quantities.frames import Elements, state_from_elements
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from tests.trajectory.flight_cases import launcher_settings


def guided(name: str = "two_stage_leo", **changes: Any) -> VehicleAscent:
    """Return a shipped ascent under guidance, explicit unless said otherwise."""
    return VehicleAscent.model_validate({**launcher_settings(name), "guidance": "explicit", **changes})


@cache
def plan(name: str = "two_stage_leo", guidance: str = "explicit", cutoff: str = "energy") -> GuidancePlan:
    """Return the plan of a shipped ascent whose runs draw all spreads; "NAME lagging": its body lags by 0.5 s."""
    lag = {"attitude_lag": "0.5 s"} if name.endswith("lagging") else {}
    return plan_ascent(guided(name.split()[0], guidance=guidance, cutoff=cutoff, dispersion={"draw": "all"}, **lag))


def state_of(**changes: float) -> np.ndarray:
    """Return position (m), velocity (m/s), frame i, and mass (kg), (7,), of an elliptic orbit with other elements."""
    numbers = {
        "semi_major_axis": 6.8e6,
        "eccentricity": 0.01,
        "inclination": 0.9,
        "node": 6.28,
        "perigee_argument": 0.3,
        "true_anomaly": 0.2,
        **changes,
    }
    r, v = state_from_elements(Elements(*(np.array(numbers[name]) for name in Elements._fields)))
    return np.concatenate([r, v, [1000.0]])


def constant_error(
    *, attitude: Any = (0, 0, 0), velocity: Any = (0, 0, 0), position: Any = (0, 0, 0)
) -> NavigationErrors:
    """Return navigation errors that last, frame i, as they are known once a second."""
    error, t = np.concatenate([attitude, velocity, position]).astype(float), np.arange(-60.0, 601.0)
    return NavigationErrors(t, np.tile(error, (t.size, 1)))
