"""Plausibility limits of a trajectory from a file. It is refused beyond them, unless its card raises the limits."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.units import AccelerationLimit, AngularRateLimit
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, FlightCard
from lvnav_trade.trajectory.truth import BEYOND, WARNING, Trajectory, motion

_STEP = 0.05  # s at most between the times at which a flight is looked at
_RATE = "is a row wrong there, an event early or late, an angle in another unit, or does one jump by a turn?"
_SHOWN = {  # by field: limited quantity, unit in messages, its size in SI, and the probable cause beyond the limit
    "highest_load": (
        "specific force",
        "g",
        STANDARD_GRAVITY,
        "is an event missing there, are digits wrong, or are the rows noisier than stated or than their digits?",
    ),
    "highest_rate": ("pitch and yaw rate", "deg/s", math.pi / 180.0, _RATE),
    "highest_spin": ("roll rate", "deg/s", math.pi / 180.0, _RATE),
    "highest_misfit": (
        "RMS misfit to the record",
        "sigma",
        1.0,
        "are digits wrong, is an event missing, or is the noise larger than stated?",
    ),
}


class FileFlightCard(FlightCard):
    """Base of the cards of trajectories from a file: plausibility limits.

    A trajectory that exceeds a limit is refused. With a higher limit in its card it is accepted, and the report begins
    with the values beyond the default limits.
    """

    highest_load: AccelerationLimit = Field(
        245.16625,  # 25 g: of the sounding rockets in use those with the strongest first motor reach some 20 g
        description="largest specific force; a trajectory beyond it is refused",
    )
    highest_rate: AngularRateLimit = Field(
        1.0471975511965976,  # 60 deg/s: ascents turn at a few deg/s, at some 30 where attitude follows noisy rows
        description="largest body rate across the roll axis; a trajectory beyond it is refused",
    )
    highest_spin: AngularRateLimit = Field(
        37.69911184307752,  # 6 turns a second: sounding rockets and spun-up stages make 1 to 5
        description="largest body rate about the roll axis; a trajectory beyond it is refused",
    )


class Peak(NamedTuple):
    """Largest value (SI) of a limited quantity, with the field of its limit, and its time in s."""

    field: str
    size: float
    time: float


def peaks(flight: Trajectory) -> tuple[Peak, ...]:
    """Return the largest specific force (m/s^2), rate across the roll axis and roll rate (rad/s) of a trajectory."""
    spans = (
        (phase.start, phase.end, max(8, math.ceil((phase.end - phase.start) / _STEP)) + 2) for phase in flight.phases
    )
    t = np.concatenate([np.linspace(*span)[1:-1] for span in spans])
    at = motion(flight, t)
    sizes = {
        "highest_load": np.linalg.norm(at.f_b, axis=1),
        "highest_rate": np.hypot(at.w_ib_b[:, 1], at.w_ib_b[:, 2]),
        "highest_spin": np.abs(at.w_ib_b[:, 0]),
    }
    return tuple(Peak(name, float(np.max(size)), float(t[np.argmax(size)])) for name, size in sizes.items())


def within_limits(flight: Trajectory, card: FileFlightCard, file: str, further: tuple[Peak, ...] = ()) -> Trajectory:
    """Return a trajectory with remarks on values beyond the default limits.

    further : Peaks in addition to those of `peaks`.

    InputError with value, time and limit of every quantity beyond the limits of the card, each at its field.
    """
    largest = [*further, *peaks(flight)]
    refused = [peak for peak in largest if peak.size > getattr(card, peak.field)]
    if refused:
        causes = [remark.text for remark in flight.remarks if remark.kind == WARNING]
        raise InputError(
            records=[Mistake(_refusal(card, file, peak, causes), f"trajectory.{peak.field}") for peak in refused]
        )
    beyond = [
        f"{_described(peak)} (usually at most {_shown(peak.field, _usual(card, peak.field))})"
        for peak in largest
        if peak.size > _usual(card, peak.field)
    ]
    return flight.remarked(BEYOND, [", ".join(beyond)] if beyond else [])


def _usual(card: FileFlightCard, field: str) -> float:
    """Return the default of a limit (SI)."""
    return float(type(card).model_fields[field].default)


def _shown(field: str, size: float) -> str:
    _, unit, factor, _ = _SHOWN[field]
    return f"{size / factor:.4g} {unit}"


def _described(peak: Peak) -> str:
    when = "with the worst row at" if peak.field == "highest_misfit" else "at"
    return f"{_SHOWN[peak.field][0]} of {_shown(peak.field, peak.size)} {when} {peak.time:.6g} s"


def _refusal(card: FileFlightCard, file: str, peak: Peak, causes: list[str]) -> str:
    allowed = getattr(card, peak.field)
    word = "usual" if allowed == _usual(card, peak.field) else "allowed"
    hints = "; ".join([_SHOWN[peak.field][3], *causes])
    return (
        f"{file}: {_described(peak)}; at most {_shown(peak.field, allowed)} is {word}: {hints}; if it is true, raise "
        f"{peak.field}"
    )
