"""Receiver card; raw observables of a block of runs."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lvnav_trade.units import Angle, Card, Frequency, Length, LengthSigma, Pause, SpeedSigma, TimeConstant
from lvnav_trade.world.receiver.antenna import AntennaCard
from lvnav_trade.world.receiver.link import LinkCard
from lvnav_trade.world.receiver.loops import LoopsCard
from lvnav_trade.world.receiver.solutions import SolutionCard
from lvnav_trade.world.receiver.tracking import TrackingCard


class ClockCard(Card):
    """A receiver oscillator by its power-law coefficients (one-sided): h0 (s), h_minus2 (1/s)."""

    h0: float = Field(ge=0)
    h_minus2: float = Field(ge=0)
    initial_bias: LengthSigma = 0.0
    initial_drift: SpeedSigma = 0.0


class ReceiverCard(Card):
    """A GNSS receiver and its antennas: what is true of its measurements.

    Without antennas, link, loops and tracking it measures every satellite above the mask, at once and with constant
    noise. Antennas alone decide which direction is heard at all; a link makes C/N0 of their gain; loops make noise and
    lock of C/N0 and of the motion; tracking makes searching and pulling in take their time.
    """

    name: str
    source: str
    rate: Frequency = Field(1.0, description="of its measurements; a filter uses all of them or every n-th")
    latency: Pause = Field(
        0.0, description="age of a measurement when the filter takes it for present; not compensated"
    )
    latency_per_satellite: Pause = Field(0.0, description="added to the latency for every satellite tracked")
    latency_error: Pause = Field(0.0, description="one-sigma of what the latency differs by over a flight")
    latency_sigma: Pause = Field(0.0, description="one-sigma of what is added to it at random, epoch by epoch")
    multipath: LengthSigma = Field(0.0, description="Gauss-Markov error of every pseudorange of its own")
    multipath_time: TimeConstant = 60.0
    lever_error: LengthSigma = Field(0.0, description="of the antenna's place on the vehicle, per body axis")
    mask: Angle = Field(0.0, description="elevation mask above the local horizontal")
    mask_height: Annotated[Length, Field(gt=0.0)] | None = Field(
        None,
        description="the mask sinks to the horizontal at this height and then with the horizon of a shell this high; "
        "none: the same everywhere",
    )
    lever_b: tuple[Length, Length, Length] = Field(
        (0.0, 0.0, 0.0), description="from the inertial unit to the point that the solution is for"
    )
    channels: int = Field(16, ge=1, le=64, description="satellites tracked at most; the highest are kept")
    pseudorange_sigma: LengthSigma = Field(description="with loops: what is there beside their thermal noise")
    range_rate_sigma: SpeedSigma = Field(description="with loops: what is there beside their thermal noise")
    solution: SolutionCard
    clock: ClockCard
    antennas: tuple[AntennaCard, ...] = Field((), description="none: one at lever_b that hears all directions alike")
    link: LinkCard | None = Field(None, description="none: no C/N0")
    loops: LoopsCard | None = Field(None, description="none: constant noise, no loss of lock; they need a link")
    tracking: TrackingCard | None = Field(None, description="none: what can be held is tracked at once")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.loops is not None and self.link is None:
            raise ValueError("loops need a link: their noise follows from its C/N0")
        return self

    @property
    def lever_arms(self) -> tuple[tuple[float, float, float], ...]:
        """Phase centres of the antennas from the inertial unit, m, body axes; `lever_b` where there are none."""
        return tuple(antenna.lever_b for antenna in self.antennas) or (self.lever_b,)
