"""Envelope card: how fast rate and acceleration of the vehicle change in the filter model, by phase and command."""

from __future__ import annotations

from pydantic import Field

from lvnav_trade.units import (
    AccelerationSigma,
    AngularAccelerationSigma,
    AngularRateSigma,
    Card,
    JerkSigma,
    Pause,
    TimeConstant,
)


class EnvelopeCard(Card):
    """Standard deviations of the steps of rate and acceleration (random walks), by phase and by what is commanded.

    Pitch and yaw: |gain / (time s + 1) commanded angular acceleration| + what is unknown in burns or coasts; lateral
    jerk: |gain / (time s + 1) rate of the commanded nozzle angle| + what is unknown. The numbers are those of Beaudoin,
    Desbiens, Gagnon and Landry, section 2.3 (equations 7 to 10).
    """

    roll: AngularAccelerationSigma = 0.002
    burn: AngularAccelerationSigma = 0.02
    coast: AngularAccelerationSigma = 0.002
    turn_gain: float = Field(5.0, ge=0.0)
    turn_time: TimeConstant = 2.0
    axial_burn: JerkSigma = 15.0
    axial_coast: JerkSigma = 10.0
    axial_change: JerkSigma = 15000.0
    before_change: Pause = 1.0
    after_change: Pause = 2.0
    lateral: JerkSigma = 10.0
    nozzle_gain: AccelerationSigma = 30.0
    nozzle_time: TimeConstant = 0.035
    start_rate: AngularRateSigma = Field(0.017453292519943295, description="of the rate before the first sample")
    start_acceleration: AccelerationSigma = Field(20.0, description="of the acceleration before the first sample")
