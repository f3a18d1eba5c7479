"""Carrier smoothing in front of a receiver's solution: its gains, and what it adds on the nominal flight."""

from collections.abc import Sequence

import numpy as np

from lvnav_trade.engines.setup.families import ErrorFamily
from lvnav_trade.engines.setup.receiver.noise import phase_sigma
from lvnav_trade.engines.setup.receiver.signals import Line
from lvnav_trade.kernels.random import source_word
from lvnav_trade.receivers.hatch import Smoothing, divergence, gains
from lvnav_trade.records import Bools, Floats, Sky
from lvnav_trade.scenario import Scenario, epoch_interval, smoothing_of
from lvnav_trade.sources import PHASE_NOISE


def smoothing_gains(scenario: Scenario, seen: Sky) -> Floats | None:
    """Return the gains (n_epoch, n_sat) of the receiver's carrier smoothing; None where there is none."""
    card = smoothing_of(scenario)
    if card is None:
        return None
    return gains(seen.tracked, _locked(seen), max(1, round(card.time / epoch_interval(scenario))))


def _locked(seen: Sky) -> Bools:
    """Return whether the carrier has been followed since the epoch before, (n_epoch, n_sat): by the same antenna, and
    without a loss between.
    """
    found = np.zeros(seen.tracked.shape, dtype=np.bool_)
    found[1:] = seen.tracked[:-1] & (seen.antenna[1:] == seen.antenna[:-1])
    for change in seen.transitions:
        epoch = int(np.searchsorted(seen.t, change.t))
        if change.before == "track" and epoch < seen.t.size:
            found[epoch, seen.names.index(change.satellite)] = False
    return found


def smoothing_numbers(
    scenario: Scenario, gain: Floats | None, seen: Sky, line: Line, families: Sequence[ErrorFamily]
) -> Smoothing | None:
    """Return the smoothing in numbers for the kernels; families: the errors that ranges share."""
    if gain is None:
        return None
    n = 2 * len(seen.names)
    code = [_in_code(family) * np.broadcast_to(family.partial[:, 0:n:2], gain.shape) for family in families]
    return Smoothing(
        gain=gain,
        sigma=phase_sigma(scenario.receiver, seen, line.trajectory),
        code=np.array(code).reshape(len(code), *gain.shape),
        source=np.uint64(source_word(PHASE_NOISE)),
    )


def _in_code(family: ErrorFamily) -> float:
    """Return how much more of an error is in the code than in the carrier, in units of what is in the code.

    The ionosphere advances the carrier by what it delays the code; multipath and wild samples are of the code; the rest
    (satellite's clock, air, time tags, lever arms) is alike in both.
    """
    if family.kind == "ionosphere_scale":
        return 2.0
    return 1.0 if family.kind == "wild" or family.source == "multipath" else 0.0


def smoothing_offsets(scenario: Scenario, gain: Floats | None, ionosphere: Floats, line: Line) -> Floats | float:
    """Return what smoothing adds to ranges and range rates on the nominal flight, (n_epoch, n_sat, 2): code and carrier
    that the ionosphere (n_epoch, n_sat) m drives apart, and a rate that is that of half an interval before.
    """
    card = smoothing_of(scenario)
    if card is None or gain is None:
        return 0.0
    late = 0.5 * card.rate_interval if card.velocity == "backward" else 0.0
    return np.stack([divergence(gain, ionosphere), -late * line.acceleration], axis=2)
