"""A launcher under control, as a scenario has it: how it turns, what steers it, which wind it meets."""

from __future__ import annotations

from pydantic import Field

from lvnav_trade.units import Card
from lvnav_trade.world.control.body import RotationCard
from lvnav_trade.world.control.controller import ControllerCard
from lvnav_trade.world.control.wind import WindCard


class ControlledCard(Card):
    """The vehicle of the ascent as a body that is steered in pitch and yaw, fed by its own navigation.

    It is flown with the raw, the filtered and the true rate on the same draws. Unit, attitude reference and the
    envelope of the filter are those of the scenario.
    """

    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard
    rate_gain: float = Field(1.0, gt=0.0, description="factor on the rate gain of every stage")
