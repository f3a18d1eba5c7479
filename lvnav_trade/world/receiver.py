"""Receiver card; raw observables of a block of runs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lvnav_trade.units import Angle, Card, Frequency, Length, LengthSigma, Pause, SpeedSigma, TimeConstant


class ClockCard(Card):
    """A receiver oscillator by its power-law coefficients (one-sided): h0 (s), h_minus2 (1/s)."""

    h0: float = Field(ge=0)
    h_minus2: float = Field(ge=0)
    initial_bias: LengthSigma = 0.0
    initial_drift: SpeedSigma = 0.0


class SolutionCard(Card):
    """The receiver's own position/velocity solution: true position and velocity plus white noise per axis."""

    kind: Literal["direct"] = "direct"
    position_sigma: LengthSigma
    velocity_sigma: SpeedSigma
    position_bias: LengthSigma = Field(0.0, description="Gauss-Markov error per axis beside the white noise")
    velocity_bias: SpeedSigma = 0.0
    bias_time: TimeConstant = Field(60.0, description="time constant of both")


class ReceiverCard(Card):
    """A GNSS receiver and its antenna: what is true of its measurements."""

    name: str
    source: str
    rate: Frequency = Field(1.0, description="of its measurements; a filter uses all of them or every n-th")
    latency: Pause = Field(
        0.0, description="age of a measurement when the filter takes it for present; not compensated"
    )
    latency_error: Pause = Field(0.0, description="one-sigma of what the latency differs by over a flight")
    latency_sigma: Pause = Field(0.0, description="one-sigma of the latency from epoch to epoch")
    multipath: LengthSigma = Field(0.0, description="Gauss-Markov error of every pseudorange of its own")
    multipath_time: TimeConstant = 60.0
    lever_error: LengthSigma = Field(0.0, description="of the antenna's place on the vehicle, per body axis")
    mask: Angle = Field(0.0, description="elevation mask above the local horizontal")
    lever_b: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    channels: int = Field(16, ge=1, le=64, description="satellites tracked at most; the highest are kept")
    pseudorange_sigma: LengthSigma
    range_rate_sigma: SpeedSigma
    solution: SolutionCard
    clock: ClockCard
