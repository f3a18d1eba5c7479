"""Carrier smoothing before a receiver's solution: its gains, and its error on the nominal flight."""

from collections.abc import Sequence

import numpy as np

from lvnav_trade.engines.setup.correlated import MULTIPATH, EnteringError
from lvnav_trade.engines.setup.receiver.further import wavelength
from lvnav_trade.engines.setup.receiver.lines import Lines
from lvnav_trade.engines.setup.receiver.noise import phase_sigma
from lvnav_trade.filter_models import epoch_interval, smoothing_of
from lvnav_trade.kernels.random import source_word
from lvnav_trade.observables.correlated import CorrelatedError
from lvnav_trade.receivers.hatch import Smoothing, gains, smoothing_error
from lvnav_trade.records import Floats, Sky
from lvnav_trade.scenario import Scenario
from lvnav_trade.sources import PHASE_NOISE


def smoothing_gains(scenario: Scenario, seen: Sky) -> Floats | None:
    """Return the gains (n_epoch, n_sat) of the receiver's carrier smoothing; None where there is none."""
    card = smoothing_of(scenario)
    if card is None:
        return None
    return gains(seen.tracked, seen.continuous, max(1, round(card.time / epoch_interval(scenario))))


def smoothing_numbers(
    scenario: Scenario, gain: Floats | None, seen: Sky, line: Lines, errors: Sequence[EnteringError]
) -> Smoothing | None:
    """Return the smoothing in numbers for the kernels; errors: those that ranges share."""
    if gain is None:
        return None
    n = 2 * len(seen.names)
    code = [_in_code(one.error) * np.broadcast_to(one.partial[:, 0:n:2], gain.shape) for one in errors]
    return Smoothing(
        gain=gain,
        sigma=phase_sigma(scenario.receiver, seen, line.trajectory),
        code=np.array(code).reshape(len(code), *gain.shape),
        source=np.uint64(source_word(PHASE_NOISE)),
    )


def _in_code(error: CorrelatedError) -> float:
    """Return how much more of an error is in the code than in the carrier, in units of what is in the code.

    The ionosphere advances the carrier by what it delays the code; multipath and wild samples are of the code; the rest
    (satellite's clock, air, time tags, lever arms) is alike in both.
    """
    if error.kind == "ionosphere_scale":
        return 2.0
    return 1.0 if error.kind == "wild" or error.source == MULTIPATH else 0.0


def smoothing_offsets(
    scenario: Scenario, gain: Floats | None, ionosphere: Floats, slip: Floats, line: Lines
) -> Floats | float:
    """Return what smoothing adds to ranges and range rates on the nominal flight, (n_epoch, n_sat, 2) m, m/s.

    gain : (n_epoch, n_sat), of `smoothing_gains`
    ionosphere : (n_epoch, n_sat) m, delay of the code and advance of the carrier
    slip : (n_epoch, n_sat) cycles of carrier phase lost or gained that the receiver has not noticed
    line : lines of sight

    A backward difference of phases is the range rate half its interval ago. A slip is taken to occur within the
    interval over which phases are differenced.
    """
    card = smoothing_of(scenario)
    if card is None or gain is None:
        return 0.0
    jump = wavelength(scenario) * slip
    rate = np.zeros_like(gain)
    if card.velocity != "doppler":
        rate = np.diff(jump, axis=0, prepend=0.0) / card.rate_interval
    if card.velocity == "backward":
        rate = rate - 0.5 * card.rate_interval * line.acceleration
    return np.stack([smoothing_error(gain, 2.0 * ionosphere - jump), rate], axis=2)
