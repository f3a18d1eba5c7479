"""True trajectory of a trajectory card, and the digest that identifies it."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.conditions import resolve
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.marks import without_marks
from lvnav_trade.trajectory.ascent.profile import RecordedAscent, rebuild
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.disturbances import oscillations
from lvnav_trade.trajectory.files.columns import TableTrajectory
from lvnav_trade.trajectory.files.contradiction import require_consistent
from lvnav_trade.trajectory.files.row_fit import file_digest
from lvnav_trade.trajectory.files.table_flight import build_table_flight, missing_events_warning, residuals
from lvnav_trade.trajectory.flights.orbital import OrbitalFlight, orbit
from lvnav_trade.trajectory.flights.sounding import SoundingFlight, launch
from lvnav_trade.trajectory.guided.controlled_flight import simulate_ascent
from lvnav_trade.trajectory.truth import Phase, Trajectory, add_oscillations, motion, reference

__all__ = [
    "Phase",
    "Trajectory",
    "TrajectoryCard",
    "build",
    "content",
    "identity",
    "motion",
    "reference",
    "refuse_contradiction",
]

TrajectoryCard = VehicleAscent | RecordedAscent | TableTrajectory | SoundingFlight | OrbitalFlight
_BUILDERS: dict[str, Callable[[Any], Trajectory]] = {
    "vehicle": simulate_ascent,
    "profile": rebuild,
    "table": build_table_flight,
    "sounding": launch,
    "orbital": orbit,
}


def build(card: TrajectoryCard) -> Trajectory:
    """Return the true trajectory of a card, with its oscillations, and with its named times among the events.

    Raises
    ------
    InputError
        The trajectory cannot be computed, or an oscillation or a named time lies outside it.
    """
    flight = _BUILDERS[card.kind](card)
    if card.named_times:
        flight = replace(flight, events=flight.events | _named_times(flight, card.named_times))
    span = (flight.start, flight.end)
    return add_oscillations(flight, oscillations(card.oscillation, flight.events, span))


def _named_times(flight: Trajectory, named_times: Mapping[str, str]) -> dict[str, float]:
    """Return the named times (s) of a card; InputError for a time outside the flight or the name of an event."""
    times = {}
    for name, text in named_times.items():
        try:
            if not name.isidentifier() or name in flight.instants:
                raise InputError(f"{name!r} is an event already, or no name for one")
            times[name] = resolve(text, flight.instants)
            if not flight.start <= times[name] <= flight.end:
                raise InputError(f"{text!r} ({times[name]:g} s) is outside the flight")
        except InputError as error:
            raise InputError(records=[Mistake(str(error), path=f"trajectory.named_times.{name}")]) from None
    return times


def content(card: TrajectoryCard) -> str:
    """Return the digest of the file of a card, empty without a file, so that a changed file is another trajectory."""
    return file_digest(card.file) if isinstance(card, RecordedAscent | TableTrajectory) else ""


def identity(card: TrajectoryCard) -> str:
    """Return 16 hexadecimal digits that identify the nominal trajectory: all numbers of the card, and its file.

    Settings that only affect guided runs do not count, because navigation is simulated on the nominal trajectory.
    """
    excluded_fields = {"name", "source", "file", "named_times"}
    data = card.model_dump(mode="json", exclude_defaults=True, exclude=excluded_fields)
    if isinstance(card, VehicleAscent):
        data["vehicle"].pop("dispersions", None)  # they change runs, not the nominal trajectory
        if data.pop("guidance", None) is not None:
            for name in ("cutoff", "dispersion", "control", "attitude_lag"):
                data.pop(name, None)
    identity_data = [type(card).__name__, without_marks(data), content(card)]
    text = json.dumps(identity_data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def refuse_contradiction(card: TrajectoryCard, imu: ImuCard) -> None:
    """Raise InputError if a user's file contradicts itself by more than is allowed for an IMU."""
    if isinstance(card, TableTrajectory):
        require_consistent(residuals(card), imu, card.file, missing_events_warning(card))
