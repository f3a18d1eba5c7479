"""Pseudoranges smoothed by carrier phase before they are solved (Hatch filter), satellite by satellite.

The average of code minus carrier follows D' = a d + (1 - a) D with d = P - phi, and the smoothed range is phi + D':
noise of the code is averaged, motion and clock go through the carrier at once. The gain a is 1/n at the n-th epoch
since the carrier was locked, and no less than that of the window. Hatch, The synergism of GPS code and carrier
measurements, 3rd Int. Symp. on Satellite Doppler Positioning, 1982.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.random import normals
from lvnav_trade.records import Bools, Floats


class Smoothing(NamedTuple):
    """A Hatch filter at the epochs: gain (n_epoch, n_sat), zero where a satellite is not in use; sigma (n_epoch, n_sat)
    m of the carrier phase; code (n_family, n_epoch, n_sat) code minus carrier with respect to the errors that
    measurements share; source: word of the draws of phase noise.
    """

    gain: Floats
    sigma: Floats
    code: Floats
    source: np.uint64


def gains(tracked: Bools, locked: Bools, longest: int) -> Floats:
    """Return the gains (n_epoch, n_sat) of satellites tracked (n_epoch, n_sat) at the epochs; locked (n_epoch, n_sat):
    without interruption since the epoch before; longest: window in epochs.
    """
    count, found = np.zeros(tracked.shape[1]), np.zeros(tracked.shape)
    for epoch in range(len(tracked)):
        count = np.where(tracked[epoch], np.where(locked[epoch], count + 1.0, 1.0), 0.0)
        found[epoch] = np.where(tracked[epoch], 1.0 / np.clip(count, 1.0, longest), 0.0)
    return found


def smoothing_error(gain: Floats, difference: Floats) -> Floats:
    """Return what smoothing adds to the errors of the code on the nominal flight, (n_epoch, n_sat) m.

    gain : (n_epoch, n_sat), zero where a satellite is not in use
    difference : (n_epoch, n_sat) m, code minus carrier: twice the ionospheric delay, less what cycle slips have added
        to the carrier

    The average of code minus carrier trails a changing difference: the error is the average less the present value.
    """
    average, found = np.zeros(gain.shape[1]), np.zeros(gain.shape)
    for epoch, a in enumerate(gain):
        average = a * difference[epoch] + (1.0 - a) * average
        found[epoch] = np.where(a > 0.0, average - difference[epoch], 0.0)
    return found


@jit
def _code_minus_carrier(shared, errors, smoothing, epoch, s):
    """Return what the errors (n_component,) that measurements share put into code minus carrier of satellite s."""
    total = like(errors[0], 0.0)
    for family in range(smoothing.code.shape[0]):
        partial = smoothing.code[family, epoch, s]
        if partial != 0.0:
            total = total + partial * errors[shared.member[family, 2 * s]]
    return total


@jit
def smooth(rx, work, smoothing, signals, word, epoch, key):
    """Smooth the pseudoranges of an epoch, with the same draws of code noise that are in them.

    rx : Receiver, `average` updated; work : Work of the run: its number, `ranges` (n_slot, 2), updated, and `shared`
    (n_component,) errors that measurements share; smoothing : Smoothing, or None; word, key : of the ranges' draws
    """
    if smoothing is None:
        return
    (k0, k1), run, ranges, errors = key, work.run[0], work.ranges, work.shared
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        code, _, _, _ = normals(k0, k1, signals.sources[1], run, word, signals.words[s])
        phase, _, _, _ = normals(k0, k1, smoothing.source, run, word, signals.words[s])
        difference = signals.sigma[epoch, 2 * s] * code - smoothing.sigma[epoch, s] * phase
        difference = difference + _code_minus_carrier(signals.shared, errors, smoothing, epoch, s)
        gain = smoothing.gain[epoch, s]
        rx.average[s] = gain * difference + (1.0 - gain) * rx.average[s]
        ranges[slot, 0] = ranges[slot, 0] + rx.average[s] - difference
