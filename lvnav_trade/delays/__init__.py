"""Atmospheric delays for truth and filter alike: models as cards, and their values on arrays.

`world` takes an `AtmosphereCard` for what is true, the filter's side a `CorrectionsCard` for its corrections; neither
knows the other's (decision 0013).
"""

from lvnav_trade.delays.cards import (
    AtmosphereCard,
    CorrectionsCard,
    IonosphereModel,
    TroposphereModel,
    correction_models,
)
from lvnav_trade.delays.models import Geometry, ionosphere_delay, troposphere_delay

__all__ = [
    "AtmosphereCard",
    "CorrectionsCard",
    "Geometry",
    "IonosphereModel",
    "TroposphereModel",
    "correction_models",
    "ionosphere_delay",
    "troposphere_delay",
]
