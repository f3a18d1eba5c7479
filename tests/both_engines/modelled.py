"""Short flights of filters with an attitude reference, for tests."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.trajectory.flight import Trajectory
from tests.building import hop, loaded, prepare_hop, with_fields

MODEL, BASELINE, UNKNOWN = (f"base.filter=filters/{n}_003" for n in ("vehicle_model", "baseline", "vehicle_unknown"))
SETTINGS = (
    "base.sensors={attitude_reference: attitude_references/magnetometer_003}",
    "base.receiver=receivers/wide_correlator_003",
    "base.initial.tilt=1 deg", "base.initial.heading=1 deg", "base.initial.position=5 m",
    "base.initial.velocity=0.1 m/s",
)  # fmt: skip
PUBLISHED, DATASHEET = "base.imu=imu/kvh1750_003_published", "base.imu=imu/kvh1750_003"


@lru_cache(maxsize=16)
def named() -> Trajectory:
    """Return the short flight with the events that a burn and a coast are known by."""
    flight = hop()
    events = {"liftoff": 0.0, "stage1_cutoff": 20.0, "end": 30.0}
    return replace(flight, events=events)


@lru_cache(maxsize=16)
def modelled(filter_card: str = MODEL, unit: str = PUBLISHED, **fields: Any) -> PreparedCase:
    """Return the short flight prepared with a filter and a unit; fields of the scenario replaced."""
    scenario = loaded(*SETTINGS, unit, filter_card)
    if fields:
        scenario = with_fields(scenario, **{name.replace("__", "."): value for name, value in fields.items()})
    return prepare_hop(scenario, named())
