"""Code and carrier tracking loops: thermal noise, lag under dynamics, and loss of lock."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import AngleSigma, Card, Frequency, JitterPerForce, TimeConstant

# Noise bandwidth (Hz) over natural frequency (rad/s) by order of the loop: Kaplan and Hegarty, table 5.6.
NATURAL = {1: 0.25, 2: 0.53, 3: 0.7845}
WEAKEST = -30.0  # dB-Hz; lower bound of C/N0, so that every noise is a finite number
PHASE_LIMIT = math.radians(15.0)  # a third of the pull-in range of 45 deg of a discriminator insensitive to data bits
NEAR_THRESHOLD = 2.0  # Kaplan and Hegarty: F of the frequency loop is 1 for strong signals, 2 near threshold
_LARGEST_LOSS = 40.0  # dB; the signal is lost at this loss


class LoopsCard(Card):
    """Delay lock loop on the code, phase or frequency lock loop on the carrier.

    The rules are those of Kaplan and Hegarty, Understanding GPS, 2nd ed., chapter 5: thermal noise of the loops from
    C/N0, steady lag under acceleration or jerk, and lock while three sigma plus the lag lie within the range of the
    discriminator.
    """

    carrier: Literal["pll", "fll"] = "pll"  # phase or frequency lock loop
    carrier_order: int = Field(
        3, ge=1, le=3, description="order of the loop: 2 or 3 for a phase loop, 1 or 2 for a frequency loop"
    )
    carrier_bandwidth: Frequency = Field(18.0, description="one-sided noise bandwidth")
    integration: TimeConstant = Field(0.02, description="coherent integration time before the discriminators")
    rate_interval: TimeConstant = Field(
        0.1, description="for a phase loop: range rate is the difference of phase over this time"
    )
    code_bandwidth: Frequency = Field(0.1, description="one-sided noise bandwidth")
    code_aided: bool = Field(
        True, description="true: the carrier loop aids the code loop; false: the code loop is of second order"
    )
    spacing: float = Field(1.0, gt=0, lt=2, description="spacing of early and late correlator, in chips")
    front_end: Frequency = Field(4e6, description="double-sided bandwidth of the front end")
    code_rate: Frequency = 1.023e6  # chips per second
    jitter: AngleSigma = Field(0.0, description="constant phase jitter of the oscillator")
    vibration: JitterPerForce = Field(
        0.0, description="phase jitter of the oscillator per specific force beyond 1 g, from vibration"
    )

    def _faults(self) -> Iterator[str]:
        orders = (2, 3) if self.carrier == "pll" else (1, 2)
        if self.carrier_order not in orders:
            yield f"carrier_order of a {self.carrier} is {orders[0]} or {orders[1]}"
        shortest = 0.5 / self.carrier_bandwidth
        if self.carrier == "pll" and self.rate_interval < shortest:
            yield f"rate_interval is shorter than the loop's own memory of {shortest:.3g} s"

    @property
    def natural_frequency(self) -> float:
        """Natural frequency of the carrier loop, rad/s."""
        return self.carrier_bandwidth / NATURAL[self.carrier_order]

    @property
    def chip_length(self) -> float:
        """Length of a chip of the code, m."""
        return SPEED_OF_LIGHT / self.code_rate


def _ratio(cn0: Floats) -> Floats:
    bounded_cn0 = np.maximum(cn0, WEAKEST)
    return np.asarray(10.0 ** (0.1 * bounded_cn0))


def code_sigma(card: LoopsCard, cn0: Floats) -> Floats:
    """Return the thermal noise of the code loop, (...,) m, one sigma.

    For a non-coherent early-minus-late discriminator. The product of correlator spacing and front-end bandwidth selects
    one of three expressions (Betz and Kolodziejski, in Kaplan and Hegarty, section 5.6.3).

    Parameters
    ----------
    card : LoopsCard
    cn0 : (...,) dB-Hz
        Carrier-to-noise density.
    """
    c = _ratio(cn0)
    spacing = card.spacing
    width = card.front_end / card.code_rate
    squaring = 2.0 / (card.integration * c * (2.0 - spacing))
    if spacing >= math.pi / width:
        shape = spacing
    elif spacing > 1.0 / width:
        excess = spacing - 1.0 / width
        shape = 1.0 / width + width / (math.pi - 1.0) * excess**2
    else:
        shape = 1.0 / width
        squaring = 1.0 / (card.integration * c)
    variance = 0.5 * card.code_bandwidth / c * shape * (1.0 + squaring)  # in squared chips
    return np.asarray(card.chip_length * np.sqrt(variance))


def phase_sigma(card: LoopsCard, cn0: Floats) -> Floats:
    """Return the thermal noise of a phase loop, (...,) rad, one sigma.

    sigma^2 = B / c (1 + 1 / (2 T c)) with bandwidth B, integration time T and the ratio c of C/N0 (1/s).

    Parameters
    ----------
    card : LoopsCard
    cn0 : (...,) dB-Hz
        Carrier-to-noise density.
    """
    c = _ratio(cn0)
    squaring = 0.5 / (card.integration * c)
    variance = card.carrier_bandwidth / c * (1.0 + squaring)
    return np.asarray(np.sqrt(variance))


def frequency_sigma(card: LoopsCard, cn0: Floats, factor: float = 1.0) -> Floats:
    """Return the thermal noise of a frequency loop, (...,) Hz, one sigma.

    sigma = sqrt(4 F B / c (1 + 1 / (T c))) / (2 pi T).

    Parameters
    ----------
    card : LoopsCard
    cn0 : (...,) dB-Hz
        Carrier-to-noise density.
    factor : float
        F: 1 for strong signals, 2 near threshold.
    """
    c = _ratio(cn0)
    period = card.integration
    squaring = 1.0 / (period * c)
    phase_variance = 4.0 * factor * card.carrier_bandwidth / c * (1.0 + squaring)
    spread = np.sqrt(phase_variance)
    return np.asarray(spread / (2.0 * math.pi * period))


def rate_sigma(card: LoopsCard, cn0: Floats, wavelength: float) -> Floats:
    """Return the thermal noise of the range rate, (...,) m/s, one sigma.

    A phase loop computes the rate from the difference of two phases with independent noise over `rate_interval`.

    Parameters
    ----------
    card : LoopsCard
    cn0 : (...,) dB-Hz
        Carrier-to-noise density.
    wavelength : float
        Wavelength of the carrier (m).
    """
    if card.carrier == "fll":
        return wavelength * frequency_sigma(card, cn0)
    phase = wavelength / (2.0 * math.pi) * phase_sigma(card, cn0)  # m
    return np.asarray(math.sqrt(2.0) * phase / card.rate_interval)


def lag(card: LoopsCard, acceleration: Floats, jerk: Floats, wavelength: float) -> Floats:
    """Return the steady-state lag of the carrier loop under dynamics, without sign, (...,).

    A phase loop of order n lags by the n-th derivative of phase over omega^n; a frequency loop of order n has one
    integrator more.

    Parameters
    ----------
    card : LoopsCard
    acceleration : (...,) m/s^2
        Second derivative of the range.
    jerk : (...,) m/s^3
        Third derivative of the range.
    wavelength : float
        Wavelength of the carrier (m).

    Returns
    -------
    (...,)
        rad for a phase loop, Hz for a frequency loop.
    """
    n_derivative = card.carrier_order + (card.carrier == "fll")
    dynamics = acceleration if n_derivative == 2 else jerk
    cycles = np.abs(dynamics) / wavelength / card.natural_frequency**card.carrier_order
    return np.asarray(2.0 * math.pi * cycles if card.carrier == "pll" else cycles)


def oscillator_jitter(card: LoopsCard, specific_force: Floats) -> Floats:
    """Return the phase jitter of the oscillator under specific force, (...,) rad, one sigma.

    Parameters
    ----------
    card : LoopsCard
    specific_force : (...,) m/s^2
        Magnitude of the specific force; vibration is proportional to its excess over 1 g.
    """
    excess = np.maximum(specific_force - 9.80665, 0.0)
    return np.hypot(card.jitter, card.vibration * excess)


def coherence_loss(card: LoopsCard, trail: Floats, jitter: Floats) -> Floats:
    """Return the loss of C/N0 due to carrier errors within an integration interval, (...,) dB.

    A Gaussian phase jitter reduces the power by exp(-sigma^2), a constant frequency error by sinc^2, and a constant
    phase error by cos^2.

    Parameters
    ----------
    card : LoopsCard
    trail : (...,) rad or Hz
        Lag of the carrier loop, as from `lag`.
    jitter : (...,) rad
        Phase jitter of the oscillator, one sigma.
    """
    if card.carrier == "fll":
        cycles = np.minimum(trail * card.integration, 1.0)
        power = np.sinc(cycles) ** 2
    else:
        angle = np.minimum(trail, 0.5 * math.pi)
        power = np.cos(angle) ** 2
    jitter_loss = 10.0 / math.log(10.0) * jitter**2
    loss = jitter_loss - 10.0 * np.log10(np.maximum(power, 1e-12))
    return np.asarray(np.minimum(loss, _LARGEST_LOSS))


def keeps_lock(card: LoopsCard, cn0: Floats, trail: Floats, jitter: Floats, acceleration: Floats) -> Bools:
    """Return whether carrier and code loop keep lock, (...,) bool.

    Parameters
    ----------
    card : LoopsCard
    cn0 : (...,) dB-Hz
    trail : (...,) rad or Hz
        Lag of the carrier loop, as from `lag`.
    jitter : (...,) rad
        Phase jitter of the oscillator, one sigma.
    acceleration : (...,) m/s^2
        Range acceleration, for the lag of an unaided code loop.

    Notes
    -----
    Phase loop: sigma + lag / 3 within 15 deg. Frequency loop: 3 sigma + lag within 1 / (4 T), T the integration time.
    Code loop: 3 sigma + lag within half the correlator spacing.
    """
    if card.carrier == "pll":
        phase_error = np.hypot(phase_sigma(card, cn0), jitter) + trail / 3.0
        carrier = phase_error <= PHASE_LIMIT
    else:
        frequency_error = 3.0 * frequency_sigma(card, cn0, NEAR_THRESHOLD) + trail
        carrier = frequency_error <= 0.25 / card.integration
    code_lag = 0.0 if card.code_aided else np.abs(acceleration) * (NATURAL[2] / card.code_bandwidth) ** 2
    code_error = 3.0 * code_sigma(card, cn0) + code_lag
    code_limit = 0.5 * card.spacing * card.chip_length
    return np.asarray(carrier & (code_error <= code_limit))
