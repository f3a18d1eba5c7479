"""Antennas and link budget: gain over the angle off boresight, and the carrier-to-noise density of the receiver."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import (
    Angle,
    AngleLimit,
    Card,
    Decibels,
    Frequency,
    Gain,
    Length,
    Level,
    NamedCard,
    Temperature,
    require_rising,
)


class CosineGain(Card):
    """Gain that falls with a power of the cosine of the angle off boresight, down to that of the back lobes."""

    kind: Literal["cosine"] = "cosine"
    peak: Gain = Field(description="gain on boresight, right-hand circular polarisation")
    exponent: float = Field(1.0, ge=0, le=1000, description="exponent of the cosine, in power: 1 loses 3 dB at 60 deg")
    front_to_back: Decibels = Field(15.0, description="largest loss relative to the peak gain")


class TableGain(Card):
    """Gain over the angle off boresight, straight lines in dBi between the entries and level beyond them."""

    kind: Literal["table"] = "table"
    angle: tuple[Angle, ...] = Field(min_length=1, description="angles off boresight, increasing")
    gain: tuple[Gain, ...] = Field(min_length=1, description="gains at those angles")

    def _faults(self) -> Iterator[str]:
        if len(self.angle) != len(self.gain):
            yield f"{len(self.angle)} angles but {len(self.gain)} gains"
        require_rising("angle", self.angle)


Pattern = Annotated[CosineGain | TableGain, Field(discriminator="kind")]


def pattern_gain(pattern: CosineGain | TableGain, angle: Floats) -> Floats:
    """Return the gain (dBi) of a pattern at angles off boresight (...,) rad, same shape.

    The gain of a cosine pattern is peak + 10 n log10(cos angle) in dBi, limited by the front-to-back ratio.
    """
    if isinstance(pattern, CosineGain):
        ahead = np.clip(np.cos(angle), 1e-30, None)
        lowest_gain = -pattern.front_to_back
        lobe_gain = np.maximum(10.0 * pattern.exponent * np.log10(ahead), lowest_gain)
        is_ahead = angle < 0.5 * math.pi
        relative_gain = np.where(is_ahead, lobe_gain, lowest_gain)
        return np.asarray(pattern.peak + relative_gain)
    return np.asarray(np.interp(angle, pattern.angle, pattern.gain))


BOLTZMANN_DB = -228.599167  # dBW/K/Hz: 10 log10 of 1.380649e-23 J/K, exact since 2019
ROOM = 290.0  # K; reference temperature of noise figures


class AntennaCard(NamedCard):
    """An antenna on the vehicle: its phase centre, boresight, and gain about the boresight."""

    source: str = ""
    lever_b: tuple[Length, Length, Length] = Field(
        (0.0, 0.0, 0.0), description="vector from the IMU to the phase centre, body axes"
    )
    boresight: tuple[float, float, float] = Field((1.0, 0.0, 0.0), description="direction in body axes, of any length")
    pattern: Pattern
    cutoff: AngleLimit = Field(
        math.pi, description="field of view as an angle off boresight; the body hides satellites beyond it"
    )

    def _faults(self) -> Iterator[str]:
        if not 0.0 < math.hypot(*self.boresight) < math.inf:
            yield f"boresight {self.boresight} has no direction"


def gain(card: AntennaCard, angle: Floats) -> Floats:
    """Return the gain (dBi) at angles off boresight (...,) rad, same shape; -inf beyond the cut-off."""
    is_in_view = angle <= card.cutoff
    return np.asarray(np.where(is_in_view, pattern_gain(card.pattern, angle), -np.inf))


def gains(cards: Sequence[AntennaCard], direction_b: Floats) -> Floats:
    """Return the gain of every antenna towards a direction, (..., n_antenna) dBi.

    Parameters
    ----------
    cards : sequence of AntennaCard
        If empty, there is one isotropic antenna of 0 dBi.
    direction_b : (..., 3)
        Unit vectors in body axes.
    """
    if not cards:
        return np.zeros((*direction_b.shape[:-1], 1))
    boresights = []
    for card in cards:
        length = math.hypot(*card.boresight)
        boresights.append(np.array(card.boresight) / length)
    axes = np.array(boresights)
    cosine = np.clip(direction_b @ axes.T, -1.0, 1.0)
    angle = np.arccos(cosine)
    antenna_gains = [gain(card, angle[..., k]) for k, card in enumerate(cards)]
    return np.stack(antenna_gains, axis=-1)


class LinkCard(Card):
    """Link budget on L1: transmitter of the satellites, losses, and noise of the receiver's front end.

    Defaults of the transmitter: the link budget of the technology handbook of Chungbuk National University (gain at
    elevations of 90, 50 and 5 deg for a user on the ground; additional loss of atmosphere, polarisation and mismatch).
    Signals that graze the Earth or come from above the horizon of an orbit leave the satellite further off nadir;
    the gain there is assumed: the parabola through the three published values.
    """

    frequency: Frequency = 1575.42e6
    transmit_power: Level = Field(16.5, description="power into the satellite's antenna")
    transmit_angle: tuple[Angle, ...] = Field(
        tuple(math.radians(angle) for angle in (0.0, 8.90, 13.85, 16.0, 20.0)),
        description="angles off the satellite's nadir, increasing",
    )
    transmit_gain: tuple[Gain, ...] = Field(
        (11.8, 15.1, 13.8, 12.5, 9.0),
        description="gains of the satellite's antenna at those angles; interpolated linearly",
    )
    loss: Decibels = Field(4.0, description="total loss by atmosphere, polarisation and mismatch of the antenna")
    antenna_temperature: Temperature = Field(130.0, description="noise temperature of the receiving antenna")
    noise_figure: Decibels = Field(2.0, description="of the receiver")
    implementation_loss: Decibels = Field(1.0, description="loss by quantisation and band limits")

    def _faults(self) -> Iterator[str]:
        if not 0 < len(self.transmit_angle) == len(self.transmit_gain):
            yield f"{len(self.transmit_angle)} transmit angles but {len(self.transmit_gain)} gains"
        require_rising("transmit_angle", self.transmit_angle)
        if self.system_temperature <= 0.0:
            yield "antenna and receiver together have no noise: antenna_temperature or noise_figure is zero"

    @property
    def system_temperature(self) -> float:
        """Noise temperature (K) of antenna and receiver, referred to the receiver's input."""
        noise_factor = 10.0 ** (0.1 * self.noise_figure)
        return self.antenna_temperature + ROOM * (noise_factor - 1.0)

    @property
    def wavelength(self) -> float:
        """Wavelength of the carrier in m."""
        return SPEED_OF_LIGHT / self.frequency


def path_loss(card: LinkCard, distance: Floats) -> Floats:
    """Return the free-space loss 20 log10(4 pi d / lambda) (dB) between isotropic antennas at a distance (m)."""
    ratio = 4.0 * math.pi * distance / card.wavelength
    return np.asarray(20.0 * np.log10(ratio))


def received_power(card: LinkCard, distance: Floats, off_nadir: Floats) -> Floats:
    """Return the power received by an isotropic antenna, (...,) dBW.

    It is the transmitted power plus the gain of the satellite's antenna, minus the free-space loss and the `loss` of
    the card.

    Parameters
    ----------
    card : LinkCard
    distance : (...,) m
        Distance to the satellite.
    off_nadir : (...,) rad
        Angle at the satellite between its nadir and the antenna.
    """
    transmit_gain = np.interp(off_nadir, card.transmit_angle, card.transmit_gain)
    radiated_power = card.transmit_power + transmit_gain
    return np.asarray(radiated_power - path_loss(card, distance) - card.loss)


def carrier_to_noise(card: LinkCard, power: Floats) -> Floats:
    """Return C/N0 (dB-Hz) of a signal from its power (dBW) at the output of the antenna: C - 10 log10(k T) - loss."""
    noise_density = BOLTZMANN_DB + 10.0 * math.log10(card.system_temperature)
    return np.asarray(power - noise_density - card.implementation_loss)
