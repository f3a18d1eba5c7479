"""Atmospheric delays that truth and belief may both choose: models as cards, and their values on arrays.

`world` takes an `AtmosphereCard` for what is true, the filter's side a `CorrectionsCard` for what is believed; neither
knows the other's (decision 0013).
"""

from __future__ import annotations

from lvnav_trade.delays.cards import (
    AtmosphereCard,
    CorrectionsCard,
    IonosphereModel,
    TroposphereModel,
    believed_ionosphere,
    believed_troposphere,
)
from lvnav_trade.delays.models import Geometry, ionosphere_delay, troposphere_delay

__all__ = [
    "AtmosphereCard",
    "CorrectionsCard",
    "Geometry",
    "IonosphereModel",
    "TroposphereModel",
    "believed_ionosphere",
    "believed_troposphere",
    "ionosphere_delay",
    "troposphere_delay",
]
