"""From a trajectory card to the true flight."""

from __future__ import annotations

from lvnav_trade.world.launch import build_ascent
from lvnav_trade.world.oscillation import oscillations
from lvnav_trade.world.profile import RecordedAscent, rebuild
from lvnav_trade.world.truth import Phase, Trajectory, motion, oscillating, reference
from lvnav_trade.world.vehicle import VehicleAscent

__all__ = ["Phase", "Trajectory", "TrajectoryCard", "build", "motion", "reference"]

TrajectoryCard = VehicleAscent | RecordedAscent


def build(card: TrajectoryCard) -> Trajectory:
    """Return the true flight of a trajectory card, its oscillations laid over it.

    InputError where it cannot be flown or rebuilt, or where an oscillation does not lie within it.
    """
    flight = _undisturbed(card)
    span = (flight.start, flight.end)
    return oscillating(flight, oscillations(card.oscillation, flight.events, span))


def _undisturbed(card: TrajectoryCard) -> Trajectory:
    if isinstance(card, VehicleAscent):
        return build_ascent(card)
    return rebuild(card)
