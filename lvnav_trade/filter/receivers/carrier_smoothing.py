"""Carrier smoothing of pseudoranges before the solution (Hatch filter), satellite by satellite.

The average of code minus carrier follows D' = a d + (1 - a) D with d = P - phi, and the smoothed range is phi + D'. The
code noise is averaged, while motion and clock enter through the carrier without delay. The gain a is 1/n at the n-th
epoch of carrier lock, and at least that of the window. Hatch, The synergism of GPS code and carrier measurements, 3rd
Int. Symp. on Satellite Doppler Positioning, 1982.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.random import normals
from lvnav_trade.quantities.records import Bools, Floats


class Smoothing(NamedTuple):
    """A Hatch filter at the epochs.

    gain : (n_epoch, n_sat). Gain; zero if the satellite is not in use.
    sigma : (n_epoch, n_sat) m. White noise of the carrier phase.
    code : (n_family, n_epoch, n_sat). Derivative of code minus carrier by the correlated measurement errors.
    source : Key of the draws of phase noise.
    """

    gain: Floats
    sigma: Floats
    code: Floats
    source: np.uint64


def gains(is_tracked: Bools, is_locked: Bools, longest: int) -> Floats:
    """Return the gains (n_epoch, n_sat) of the Hatch filter.

    is_tracked : (n_epoch, n_sat). Whether the satellite is tracked.
    is_locked : (n_epoch, n_sat). Whether its carrier was tracked without interruption since the previous epoch.
    longest : Window in epochs.
    """
    count = np.zeros(is_tracked.shape[1])
    gain = np.zeros(is_tracked.shape)
    for epoch in range(len(is_tracked)):
        epochs_of_lock = np.where(is_locked[epoch], count + 1.0, 1.0)
        count = np.where(is_tracked[epoch], epochs_of_lock, 0.0)
        gain[epoch] = np.where(is_tracked[epoch], 1.0 / np.clip(count, 1.0, longest), 0.0)
    return gain


def smoothing_error(gain: Floats, difference: Floats) -> Floats:
    """Return the range error (n_epoch, n_sat) m due to the lag of the smoothing filter on the nominal flight.

    The average of code minus carrier lags behind a changing difference: the error is average minus present value.

    gain : (n_epoch, n_sat). Gain as from `gains`.
    difference : (n_epoch, n_sat) m. Code minus carrier: twice the ionospheric delay, less the accumulated cycle slips.
    """
    average = np.zeros(gain.shape[1])
    error = np.zeros(gain.shape)
    for epoch, a in enumerate(gain):
        average = a * difference[epoch] + (1.0 - a) * average
        error[epoch] = np.where(a > 0.0, average - difference[epoch], 0.0)
    return error


@jit
def _code_minus_carrier(correlated_errors, errors, smoothing, epoch, s):
    """Return code minus carrier (m) of satellite s due to the correlated measurement errors (n_component,)."""
    total = number_like(errors[0], 0.0)
    for family in range(smoothing.code.shape[0]):
        partial = smoothing.code[family, epoch, s]
        if partial != 0.0:
            component = correlated_errors.member[family, 2 * s]
            total = total + partial * errors[component]
    return total


@jit
def smooth(receiver, work, smoothing, signals, word, epoch, key):
    """Smooth the pseudoranges of an epoch. The code noise is drawn again with the key of the ranges: the same values.

    Parameters
    ----------
    receiver : Receiver
        `average` is updated.
    work : Work
        Arrays of the run: its number, `ranges` (n_slot, 2), updated, and `correlated_errors` (n_component,).
    smoothing : Smoothing or None
    signals : Signals
    word, key
        Counter word and key of the draws of range noise.
    epoch : int
    """
    if smoothing is None:
        return
    k0, k1 = key
    run = work.run[0]
    ranges = work.ranges
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        code_normal, _, _, _ = normals(k0, k1, signals.source_keys[1], run, word, signals.satellite_keys[s])
        phase_normal, _, _, _ = normals(k0, k1, smoothing.source, run, word, signals.satellite_keys[s])
        # code minus carrier: white noise of both, then correlated errors; range and clock are in both
        code_noise = signals.sigma[epoch, 2 * s] * code_normal
        phase_noise = smoothing.sigma[epoch, s] * phase_normal
        correlated_error = _code_minus_carrier(signals.correlated_errors, work.correlated_errors, smoothing, epoch, s)
        difference = code_noise - phase_noise
        difference = difference + correlated_error
        gain = smoothing.gain[epoch, s]
        previous_average = receiver.average[s]
        average = gain * difference + (1.0 - gain) * previous_average
        receiver.average[s] = average
        ranges[slot, 0] = ranges[slot, 0] + average - difference
