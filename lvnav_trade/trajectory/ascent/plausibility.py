"""Plausibility limits of a trajectory from a file. It is refused beyond them, unless its card raises the limits."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.units import AccelerationLimit, AngularRateLimit
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, FlightCard
from lvnav_trade.trajectory.truth import BEYOND, WARNING, Trajectory, motion

_STEP = 0.05  # s; longest interval between the times at which a trajectory is evaluated


class _Limit(NamedTuple):
    """A limited quantity.

    quantity : Its name in messages.
    unit : Unit in messages.
    size : Size of that unit in SI.
    cause : Probable cause of a value beyond the limit.
    """

    quantity: str
    unit: str
    size: float
    cause: str


_WRONG_RATE = "is a row wrong there, an event early or late, an angle in another unit, or does one jump by a turn?"
_LIMITS = {
    "highest_load": _Limit(
        quantity="specific force",
        unit="g",
        size=STANDARD_GRAVITY,
        cause="is an event missing there, are digits wrong, or are the rows noisier than stated or than their digits?",
    ),
    "highest_rate": _Limit("pitch and yaw rate", "deg/s", math.pi / 180.0, _WRONG_RATE),
    "highest_spin": _Limit("roll rate", "deg/s", math.pi / 180.0, _WRONG_RATE),
    "highest_misfit": _Limit(
        quantity="RMS misfit to the record",
        unit="sigma",
        size=1.0,
        cause="are digits wrong, is an event missing, or is the noise larger than stated?",
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
    times = []
    for phase in flight.phases:
        n_interval = max(8, math.ceil((phase.end - phase.start) / _STEP))
        times.append(np.linspace(phase.start, phase.end, n_interval + 2)[1:-1])
    t = np.concatenate(times)
    true = motion(flight, t)
    sizes = {
        "highest_load": np.linalg.norm(true.f_b, axis=1),
        "highest_rate": np.hypot(true.w_ib_b[:, 1], true.w_ib_b[:, 2]),
        "highest_spin": np.abs(true.w_ib_b[:, 0]),
    }
    largest = []
    for name, size in sizes.items():
        time = float(t[np.argmax(size)])
        largest.append(Peak(name, float(np.max(size)), time))
    return tuple(largest)


def add_limit_remarks(
    flight: Trajectory, card: FileFlightCard, file: str, further_peaks: tuple[Peak, ...] = ()
) -> Trajectory:
    """Return a trajectory with remarks on values beyond the default limits.

    Parameters
    ----------
    flight : Trajectory
        The trajectory.
    card : FileFlightCard
        Card with the limits.
    file : str
        Name of the file, for messages.
    further_peaks : tuple of Peak
        Peaks in addition to those of `peaks`.

    Raises
    ------
    InputError
        Quantities exceed the limits of the card. The message has value, time and limit of each, at its field.
    """
    largest = [*further_peaks, *peaks(flight)]
    causes = [remark.text for remark in flight.remarks if remark.category == WARNING]
    mistakes = []
    for peak in largest:
        if peak.size > getattr(card, peak.field):
            message = _refusal(card, file, peak, causes)
            mistakes.append(Mistake(message, f"trajectory.{peak.field}"))
    if mistakes:
        raise InputError(records=mistakes)
    excess_texts = []
    for peak in largest:
        default = _default_limit(card, peak.field)
        if peak.size > default:
            excess_texts.append(f"{_peak_text(peak)} (usually at most {_size_text(peak.field, default)})")
    return flight.add_remarks(BEYOND, [", ".join(excess_texts)] if excess_texts else [])


def _default_limit(card: FileFlightCard, field: str) -> float:
    """Return the default of a limit (SI)."""
    return float(type(card).model_fields[field].default)


def _size_text(field: str, size: float) -> str:
    limit = _LIMITS[field]
    return f"{size / limit.size:.4g} {limit.unit}"


def _peak_text(peak: Peak) -> str:
    time_prefix = "with the worst row at" if peak.field == "highest_misfit" else "at"
    quantity = _LIMITS[peak.field].quantity
    size = _size_text(peak.field, peak.size)
    return f"{quantity} of {size} {time_prefix} {peak.time:.6g} s"


def _refusal(card: FileFlightCard, file: str, peak: Peak, causes: list[str]) -> str:
    """Return the message on a peak beyond the limit of its card.

    causes : texts of the warnings about the file, which may explain the peak
    """
    limit = getattr(card, peak.field)
    word = "usual" if limit == _default_limit(card, peak.field) else "allowed"
    hints = "; ".join([_LIMITS[peak.field].cause, *causes])
    return (
        f"{file}: {_peak_text(peak)}; at most {_size_text(peak.field, limit)} is {word}: {hints}; if it is true, "
        f"raise {peak.field}"
    )
