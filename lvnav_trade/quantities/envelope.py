"""Motion envelope of a launch vehicle: steps of rate and acceleration assumed by a filter model."""

import math

import numpy as np
from pydantic import Field

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Bools, Floats


class EnvelopeCard(units.Card):
    """Standard deviations of the steps of rate and acceleration (random walks), by phase and by command.

    Pitch and yaw: |gain / (time s + 1) commanded angular acceleration| plus the unknown part in burns or coasts.
    Lateral jerk: |gain / (time s + 1) rate of the commanded nozzle angle| plus the unknown part. The numbers are those
    of Beaudoin, Desbiens, Gagnon and Landry, section 2.3 (equations 7 to 10).
    """

    roll: units.AngularAccelerationSigma = 0.002  # roll acceleration
    burn: units.AngularAccelerationSigma = 0.02  # unknown pitch and yaw acceleration in burns
    coast: units.AngularAccelerationSigma = 0.002  # unknown pitch and yaw acceleration in coasts
    turn_gain: float = Field(5.0, ge=0.0)  # gain on the commanded angular acceleration
    turn_time: units.TimeConstant = 2.0  # time constant of the response to that command
    axial_burn: units.JerkSigma = 15.0  # axial jerk in burns
    axial_coast: units.JerkSigma = 10.0  # axial jerk in coasts
    axial_change: units.JerkSigma = 15000.0  # axial jerk around ignition, cut-off and separation
    before_change: units.Pause = 1.0  # time before such a change for which it is assumed
    after_change: units.Pause = 2.0  # time after such a change for which it is assumed
    lateral: units.JerkSigma = 10.0  # unknown lateral jerk
    nozzle_gain: units.AccelerationSigma = 30.0  # lateral acceleration per nozzle angle
    nozzle_time: units.TimeConstant = 0.035  # time constant of the response to the nozzle
    start_rate: units.AngularRateSigma = Field(
        0.017453292519943295, description="initial one-sigma of the rate, before the first sample"
    )
    start_acceleration: units.AccelerationSigma = Field(
        20.0, description="initial one-sigma of the acceleration, before the first sample"
    )


def changing(card: EnvelopeCard, t: Floats, changes: Floats) -> Bools:
    """Return whether each time t (n,) s lies within the window around a change of phase, `changes` (k,) s, rising."""
    begin = np.searchsorted(changes, t - card.after_change, side="left")
    return np.asarray(np.searchsorted(changes, t + card.before_change, side="right") > begin)


def steady_ratio(driving: float, noise: float) -> float:
    """Return the steady-state variance of a scalar random walk after an update over the measurement variance.

    It equals the steady-state gain: (-x + sqrt(x^2 + 4 x)) / 2 with x = driving / noise.

    driving : Variance of a step of the random walk.
    noise : Variance of a measurement.
    """
    x = driving / noise
    return 0.5 * (math.sqrt(x * x + 4.0 * x) - x)
