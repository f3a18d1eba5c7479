"""From a trajectory card to the true flight."""

from __future__ import annotations

from lvnav_trade.world.launch import build_ascent
from lvnav_trade.world.profile import RecordedAscent, rebuild
from lvnav_trade.world.truth import Phase, Trajectory, motion, reference
from lvnav_trade.world.vehicle import VehicleAscent

__all__ = ["Phase", "Trajectory", "build", "motion", "reference"]


def build(card: VehicleAscent | RecordedAscent) -> Trajectory:
    """Return the true flight of a trajectory card; InputError where it cannot be flown or rebuilt."""
    if isinstance(card, VehicleAscent):
        return build_ascent(card)
    return rebuild(card)
