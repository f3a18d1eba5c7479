"""Link budget: from what a satellite radiates to the carrier-to-noise density that a receiver works with."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.records import Floats
from lvnav_trade.units import Angle, Card, Decibels, Frequency, Gain, Level, Temperature

BOLTZMANN_DB = -228.599167  # dBW/K/Hz: 10 log10 of 1.380649e-23 J/K, exact since 2019
ROOM = 290.0  # K; the temperature that noise figures refer to


class LinkCard(Card):
    """What the satellites radiate on L1 and what the front end of the receiver adds.

    Defaults of the transmitter: the link budget of the technology handbook of Chungbuk National University (gain at
    elevations of 90, 50 and 5 deg for a user on the ground; additional loss of atmosphere, polarisation and mismatch).
    Signals that graze the Earth or come from above the horizon of an orbit leave the satellite further off nadir;
    the gain there is assumed: the parabola through the three published values.
    """

    frequency: Frequency = 1575.42e6
    transmit_power: Level = Field(16.5, description="into the satellite's antenna")
    transmit_angle: tuple[Angle, ...] = Field(
        tuple(math.radians(angle) for angle in (0.0, 8.90, 13.85, 16.0, 20.0)),
        description="off the satellite's nadir, rising",
    )
    transmit_gain: tuple[Gain, ...] = Field(
        (11.8, 15.1, 13.8, 12.5, 9.0), description="of the satellite's antenna there; straight lines between"
    )
    loss: Decibels = Field(4.0, description="atmosphere, polarisation and mismatch of the antenna together")
    antenna_temperature: Temperature = Field(130.0, description="noise that the receiving antenna takes in")
    noise_figure: Decibels = Field(2.0, description="of the receiver")
    implementation_loss: Decibels = Field(1.0, description="by quantisation and band limits")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not 0 < len(self.transmit_angle) == len(self.transmit_gain):
            raise ValueError(f"{len(self.transmit_angle)} transmit angles but {len(self.transmit_gain)} gains")
        if any(later <= earlier for earlier, later in zip(self.transmit_angle, self.transmit_angle[1:], strict=False)):
            raise ValueError("transmit_angle must rise from entry to entry")
        if self.system_temperature <= 0.0:
            raise ValueError("antenna and receiver together have no noise: antenna_temperature or noise_figure is zero")
        return self

    @property
    def system_temperature(self) -> float:
        """Noise temperature (K) of antenna and receiver, referred to the receiver's input."""
        return self.antenna_temperature + ROOM * (10.0 ** (0.1 * self.noise_figure) - 1.0)

    @property
    def wavelength(self) -> float:
        """Wavelength of the carrier in m."""
        return SPEED_OF_LIGHT / self.frequency


def path_loss(card: LinkCard, distance: Floats) -> Floats:
    """Return the free-space loss (dB) between isotropic antennas at a distance (m)."""
    return np.asarray(20.0 * np.log10(4.0 * math.pi * distance / card.wavelength))


def received_power(card: LinkCard, distance: Floats, off_nadir: Floats) -> Floats:
    """Return the power (dBW) that an isotropic antenna receives.

    distance (m) from the satellite; off_nadir (rad) the angle at the satellite between its nadir and the antenna; both
    of the same shape.
    """
    transmitted = card.transmit_power + np.interp(off_nadir, card.transmit_angle, card.transmit_gain)
    return np.asarray(transmitted - path_loss(card, distance) - card.loss)


def carrier_to_noise(card: LinkCard, power: Floats) -> Floats:
    """Return C/N0 (dB-Hz) of a signal whose power at the antenna's output is given in dBW."""
    noise = BOLTZMANN_DB + 10.0 * math.log10(card.system_temperature)
    return np.asarray(power - noise - card.implementation_loss)


def off_nadir(r_sat: Floats, direction: Floats) -> Floats:
    """Return the angle (rad) at the satellite between its nadir and the antenna.

    r_sat (..., 3) from the Earth's centre; direction (..., 3) unit vector from antenna to satellite, same axes.
    """
    along = np.sum(r_sat * direction, axis=-1) / np.linalg.norm(r_sat, axis=-1)
    return np.asarray(np.arccos(np.clip(along, -1.0, 1.0)))
