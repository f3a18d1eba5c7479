"""Code and carrier tracking loops: their noise, their lag under dynamics, and when they let go."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.records import Bools, Floats
from lvnav_trade.units import AngleSigma, Card, Frequency, JitterPerForce, TimeConstant

# Natural frequency (rad/s) of a loop is its noise bandwidth (Hz) over this, by order: Kaplan and Hegarty, table 5.6.
NATURAL = {1: 0.25, 2: 0.53, 3: 0.7845}
WEAKEST = -30.0  # dB-Hz; what is weaker counts as this, so that every noise is a finite number
PHASE_LIMIT = math.radians(15.0)  # a third of what a discriminator blind to data bits takes for the right side
NEAR_THRESHOLD = 2.0  # Kaplan and Hegarty: F of the frequency loop is 1 for strong signals, 2 where it is about to slip
_LARGEST_LOSS = 40.0  # dB; beyond, nothing is left of the signal


class LoopsCard(Card):
    """Delay lock loop on the code, phase or frequency lock loop on the carrier.

    The rules are those of Kaplan and Hegarty, Understanding GPS, 2nd ed., chapter 5: thermal noise of the loops from
    C/N0, steady lag behind acceleration or jerk, and lock while three sigma and the lag together lie within what the
    discriminator can tell.
    """

    carrier: Literal["pll", "fll"] = "pll"  # phase or frequency lock loop
    carrier_order: int = Field(3, ge=1, le=3, description="2 or 3 of a phase loop, 1 or 2 of a frequency loop")
    carrier_bandwidth: Frequency = Field(18.0, description="one-sided noise bandwidth")
    integration: TimeConstant = Field(0.02, description="coherent, before the discriminators")
    rate_interval: TimeConstant = Field(
        0.1, description="of a phase loop: range rate is the difference of phase over this time"
    )
    code_bandwidth: Frequency = Field(0.1, description="one-sided noise bandwidth")
    code_aided: bool = Field(True, description="the carrier loop moves the code; else the code loop is of second order")
    spacing: float = Field(1.0, gt=0, lt=2, description="of early and late correlator, chips")
    front_end: Frequency = Field(4e6, description="double-sided bandwidth")
    code_rate: Frequency = 1.023e6  # chips per second
    jitter: AngleSigma = Field(0.0, description="phase jitter of the oscillator, always there")
    vibration: JitterPerForce = Field(
        0.0, description="phase jitter of the oscillator per specific force beyond one g: it shakes as the motor pushes"
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
    def chip(self) -> float:
        """Length of a chip of the code, m."""
        return SPEED_OF_LIGHT / self.code_rate


def _ratio(cn0: Floats) -> Floats:
    return np.asarray(10.0 ** (0.1 * np.maximum(cn0, WEAKEST)))


def code_sigma(card: LoopsCard, cn0: Floats) -> Floats:
    """Return the thermal noise (m, one sigma) of the code loop at C/N0 (dB-Hz, any shape).

    A non-coherent early-minus-late discriminator; which of the three expressions holds depends on spacing times
    front-end bandwidth (Betz and Kolodziejski, in Kaplan and Hegarty, section 5.6.3).
    """
    c, spacing, width = _ratio(cn0), card.spacing, card.front_end / card.code_rate
    squaring = 2.0 / (card.integration * c * (2.0 - spacing))
    if spacing >= math.pi / width:
        shape = spacing
    elif spacing > 1.0 / width:
        shape = 1.0 / width + width / (math.pi - 1.0) * (spacing - 1.0 / width) ** 2
    else:
        shape, squaring = 1.0 / width, 1.0 / (card.integration * c)
    return np.asarray(card.chip * np.sqrt(0.5 * card.code_bandwidth / c * shape * (1.0 + squaring)))


def phase_sigma(card: LoopsCard, cn0: Floats) -> Floats:
    """Return the thermal noise (rad, one sigma) of a phase loop at C/N0 (dB-Hz)."""
    c = _ratio(cn0)
    return np.asarray(np.sqrt(card.carrier_bandwidth / c * (1.0 + 0.5 / (card.integration * c))))


def frequency_sigma(card: LoopsCard, cn0: Floats, factor: float = 1.0) -> Floats:
    """Return the thermal noise (Hz, one sigma) of a frequency loop at C/N0 (dB-Hz); factor: F of the book, 1 to 2."""
    c, period = _ratio(cn0), card.integration
    spread = np.sqrt(4.0 * factor * card.carrier_bandwidth / c * (1.0 + 1.0 / (period * c)))
    return np.asarray(spread / (2.0 * math.pi * period))


def rate_sigma(card: LoopsCard, cn0: Floats, wavelength: float) -> Floats:
    """Return the thermal noise (m/s, one sigma) of the range rate at C/N0 (dB-Hz); wavelength in m."""
    if card.carrier == "fll":
        return wavelength * frequency_sigma(card, cn0)
    return np.asarray(math.sqrt(2.0) * (wavelength / (2.0 * math.pi) * phase_sigma(card, cn0)) / card.rate_interval)


def lag(card: LoopsCard, acceleration: Floats, jerk: Floats, wavelength: float) -> Floats:
    """Return by how much the carrier loop trails under steady dynamics: rad of a phase loop, Hz of a frequency loop.

    acceleration (m/s^2) and jerk (m/s^3) of the range, same shape; result without sign.
    """
    along = acceleration if card.carrier_order + (card.carrier == "fll") == 2 else jerk
    cycles = np.abs(along) / wavelength / card.natural_frequency**card.carrier_order
    return np.asarray(2.0 * math.pi * cycles if card.carrier == "pll" else cycles)


def shaking(card: LoopsCard, specific_force: Floats) -> Floats:
    """Return the phase jitter (rad, one sigma) of the oscillator under a specific force (m/s^2)."""
    return np.hypot(card.jitter, card.vibration * np.maximum(specific_force - 9.80665, 0.0))


def coherence_loss(card: LoopsCard, trail: Floats, jitter: Floats) -> Floats:
    """Return how much C/N0 (dB) is lost because the carrier is not followed within an integration.

    trail as of `lag`, jitter (rad) of the oscillator; same shape. A Gaussian phase leaves exp(-sigma^2) of the power, a
    constant error of frequency sinc^2, one of phase cos^2.
    """
    if card.carrier == "fll":
        left = np.sinc(np.minimum(trail * card.integration, 1.0)) ** 2
    else:
        left = np.cos(np.minimum(trail, 0.5 * math.pi)) ** 2
    loss = 10.0 / math.log(10.0) * jitter**2 - 10.0 * np.log10(np.maximum(left, 1e-12))
    return np.asarray(np.minimum(loss, _LARGEST_LOSS))


def holds(card: LoopsCard, cn0: Floats, trail: Floats, jitter: Floats, acceleration: Floats) -> Bools:
    """Return whether carrier and code loop stay in lock.

    Phase loop: sigma + lag / 3 within 15 deg. Frequency loop: 3 sigma + lag within a quarter of the rate of
    integrations. Code loop: 3 sigma + lag within half the spacing. All arguments of one shape: C/N0 (dB-Hz); trail as
    of `lag`; jitter (rad) of the oscillator; acceleration (m/s^2) of the range.
    """
    if card.carrier == "pll":
        carrier = np.hypot(phase_sigma(card, cn0), jitter) + trail / 3.0 <= PHASE_LIMIT
    else:
        carrier = 3.0 * frequency_sigma(card, cn0, NEAR_THRESHOLD) + trail <= 0.25 / card.integration
    behind = 0.0 if card.code_aided else np.abs(acceleration) * (NATURAL[2] / card.code_bandwidth) ** 2
    return np.asarray(carrier & (3.0 * code_sigma(card, cn0) + behind <= 0.5 * card.spacing * card.chip))
