"""Antenna gain over the angle off boresight: patterns of receiver antennas and of jamming transmitters."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import Angle, Card, Decibels, Gain, require_rising


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
        fall = np.maximum(10.0 * pattern.exponent * np.log10(ahead), -pattern.front_to_back)
        return np.asarray(pattern.peak + np.where(angle < 0.5 * math.pi, fall, -pattern.front_to_back))
    return np.asarray(np.interp(angle, pattern.angle, pattern.gain))
