"""Cost, mass, power, volume and reliability of a device: of cards, and kept out of digests."""

from pydantic import Field

from lvnav_trade import units


class Resources(units.Card):
    """What a device costs and needs: no part of what is computed, and of no digest. Totals are of the whole design."""

    cost: float | None = Field(
        None, ge=0.0, description="in a currency of the campaign's choice, the same for all cards"
    )
    mass: units.Mass | None = None
    power: units.Power | None = None
    volume: units.Volume | None = None
    mtbf: units.Hours | None = Field(None, description="mean time between failures; failure rates of the devices add")
    source: str = Field("", description="where these are from, and which are assumed")
