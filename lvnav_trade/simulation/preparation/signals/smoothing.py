"""Carrier smoothing in the receiver: gains, and error on the nominal flight."""

from collections.abc import Sequence

import numpy as np

from lvnav_trade.filter.receivers.carrier_smoothing import Smoothing, gains, smoothing_error
from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.error_sources import PHASE_NOISE
from lvnav_trade.quantities.records import Floats, Sky
from lvnav_trade.scenario.filter_models import carrier_smoothing, epoch_interval
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.correlated import MULTIPATH, EnteringError
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.simulation.preparation.signals.noise import phase_sigma
from lvnav_trade.simulation.preparation.signals.phases_and_differences import wavelength


def smoothing_gains(scenario: Scenario, sky: Sky) -> Floats | None:
    """Return the gains (n_epoch, n_sat) of the receiver's carrier smoothing; None without."""
    card = carrier_smoothing(scenario)
    if card is None:
        return None
    window = max(1, round(card.time / epoch_interval(scenario)))
    return gains(sky.is_tracked, sky.continuous, window)


def smoothing_numbers(
    scenario: Scenario,
    gain: Floats | None,
    sky: Sky,
    line: Lines,
    errors: Sequence[EnteringError],
) -> Smoothing | None:
    """Return the carrier smoothing as arrays for the kernels; None without.

    Parameters
    ----------
    scenario
        Validated model of the case.
    gain
        (n_epoch, n_sat). Gains of `smoothing_gains`; None without smoothing.
    sky, line
        Satellites at the epochs, lines of sight.
    errors
        Correlated errors of the ranges.
    """
    if gain is None:
        return None
    n = 2 * len(sky.names)
    code = []
    for item in errors:
        range_partial = np.broadcast_to(item.partial[:, 0:n:2], gain.shape)
        code.append(_code_share(item.error) * range_partial)
    return Smoothing(
        gain=gain,
        sigma=phase_sigma(scenario.receiver, sky, line.trajectory),
        code=np.array(code).reshape(len(code), *gain.shape),
        source=np.uint64(source_word(PHASE_NOISE)),
    )


def _code_share(error: CorrelatedError) -> float:
    """Return the difference between the errors of code and carrier, relative to that of the code.

    The ionosphere advances the carrier as much as it delays the code (2). Multipath and wild samples affect the code
    only (1). All other errors (satellite clock, troposphere, time tags, lever arms) are equal in both (0).
    """
    if error.error_type == "ionosphere_scale":
        return 2.0
    return 1.0 if error.error_type == "wild" or error.source == MULTIPATH else 0.0


def smoothing_offsets(
    scenario: Scenario,
    gain: Floats | None,
    ionosphere: Floats,
    slip: Floats,
    line: Lines,
) -> Floats | float:
    """Return the error of ranges and rates by carrier smoothing on the nominal flight, (n_epoch, n_sat, 2) m, m/s.

    A backward difference of phases is the range rate half of its interval ago. A slip is assumed to occur within the
    interval over which phases are differenced.

    Parameters
    ----------
    scenario
        Validated model of the case.
    gain
        (n_epoch, n_sat). Gains of `smoothing_gains`.
    ionosphere
        (n_epoch, n_sat) m. Delay of the code and advance of the carrier.
    slip
        (n_epoch, n_sat) cycles. Undetected cycle slips.
    line
        Lines of sight.
    """
    card = carrier_smoothing(scenario)
    if card is None or gain is None:
        return 0.0
    jump = wavelength(scenario) * slip
    rate = np.zeros_like(gain)
    if card.velocity != "doppler":
        rate = np.diff(jump, axis=0, prepend=0.0) / card.rate_interval
    if card.velocity == "backward":
        rate = rate - 0.5 * card.rate_interval * line.acceleration
    return np.stack([smoothing_error(gain, 2.0 * ionosphere - jump), rate], axis=2)
