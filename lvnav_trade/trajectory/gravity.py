"""Disturbance of the true gravity along the flight, beyond any gravity model."""

import math

from pydantic import Field

from lvnav_trade.quantities.state_layout import NO_SENSOR, ErrorTerm
from lvnav_trade.quantities.units import AccelerationSigma, Card, TimeConstant

# Driver of a disturbance that is no sensor error: an acceleration along the axes of frame i.
GRAVITY = -2


class GravityCard(Card):
    """Gravity disturbance as a Gauss-Markov process in time, per axis (10 to 50 mGal over land; a correlation length of
    tens of kilometres passes in seconds at orbital speed: Jordan, J. Geophys. Res. 77 (1972) 3660).
    """

    sigma: AccelerationSigma
    time: TimeConstant | None = Field(20.0, description="correlation time; none: constant over the flight")


def disturbance(card: GravityCard | None) -> tuple[ErrorTerm, ...]:
    """Return the disturbance as a true error term in a tuple; an empty tuple without a card or with zero sigma."""
    if card is None or card.sigma == 0.0:
        return ()
    return (ErrorTerm("gravity disturbance", 0, NO_SENSOR, GRAVITY, card.sigma, 0.0, card.time or math.inf),)
