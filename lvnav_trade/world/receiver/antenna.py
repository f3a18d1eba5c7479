"""Antennas fixed to the body: where each is, which way it looks, and with what gain it receives from there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from lvnav_trade.records import Floats
from lvnav_trade.units import Angle, Card, Decibels, Gain, Length


class CosineGain(Card):
    """Gain that falls with a power of the cosine of the angle off boresight, down to that of the back lobes."""

    kind: Literal["cosine"] = "cosine"
    peak: Gain = Field(description="on boresight, right-hand circular")
    exponent: float = Field(1.0, ge=0, description="of the cosine, in power: 1 loses 3 dB at 60 deg")
    front_to_back: Decibels = Field(15.0, description="the gain is never lower than the peak by more than this")


class TableGain(Card):
    """Gain over the angle off boresight, straight lines in dBi between the entries and level beyond them."""

    kind: Literal["table"] = "table"
    angle: tuple[Angle, ...] = Field(min_length=1, description="off boresight, rising")
    gain: tuple[Gain, ...] = Field(min_length=1, description="at those angles")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.angle) != len(self.gain):
            raise ValueError(f"{len(self.angle)} angles but {len(self.gain)} gains")
        if any(later <= earlier for earlier, later in zip(self.angle, self.angle[1:], strict=False)):
            raise ValueError("angle must rise from entry to entry")
        return self


class AntennaCard(Card):
    """An antenna on the body: where its phase centre is, which way it looks, its gain around that axis."""

    name: str
    source: str = ""
    lever_b: tuple[Length, Length, Length] = Field(
        (0.0, 0.0, 0.0), description="phase centre from the inertial unit, body axes"
    )
    boresight: tuple[float, float, float] = Field((1.0, 0.0, 0.0), description="direction in body axes, of any length")
    pattern: Annotated[CosineGain | TableGain, Field(discriminator="kind")]
    cutoff: Annotated[Angle, Field(gt=0.0)] = Field(
        math.pi, description="off boresight; what lies further off is hidden by the body"
    )

    @model_validator(mode="after")
    def _directed(self) -> Self:
        if not 0.0 < math.hypot(*self.boresight) < math.inf:
            raise ValueError(f"boresight {self.boresight} has no direction")
        return self


def gain(card: AntennaCard, angle: Floats) -> Floats:
    """Return the gain (dBi) at angles off boresight (rad, any shape); -inf beyond the cut-off."""
    pattern = card.pattern
    if isinstance(pattern, CosineGain):
        ahead = np.clip(np.cos(angle), 1e-30, None)
        fall = np.maximum(10.0 * pattern.exponent * np.log10(ahead), -pattern.front_to_back)
        level = pattern.peak + np.where(angle < 0.5 * math.pi, fall, -pattern.front_to_back)
    else:
        level = np.interp(angle, pattern.angle, pattern.gain)
    return np.asarray(np.where(angle <= card.cutoff, level, -np.inf))


def gains(cards: Sequence[AntennaCard], direction_b: Floats) -> Floats:
    """Return the gain (dBi) of every antenna towards unit vectors in body axes.

    direction_b (..., 3); result (..., n_antenna). Without antennas there is one that hears all directions with 0 dBi.
    """
    if not cards:
        return np.zeros((*direction_b.shape[:-1], 1))
    axes = np.array([np.array(card.boresight) / math.hypot(*card.boresight) for card in cards])
    angle = np.arccos(np.clip(direction_b @ axes.T, -1.0, 1.0))
    return np.stack([gain(card, angle[..., k]) for k, card in enumerate(cards)], axis=-1)
