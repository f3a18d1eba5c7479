"""Cost, mass, power, volume and reliability of a device: part of its card, but not of the digest of a case."""

from pydantic import Field

from lvnav_trade.quantities import units


class Resources(units.Card):
    """Cost and resources of a device. They do not affect results and digests. The report adds them up for a design."""

    cost: float | None = Field(
        None, ge=0.0, description="in a currency of the campaign's choice, the same for all cards"
    )
    mass: units.Mass | None = None
    power: units.Power | None = None
    volume: units.Volume | None = None
    mtbf: units.Hours | None = Field(None, description="mean time between failures; failure rates of the devices add")
    source: str = Field("", description="sources of these numbers, and which of them are assumed")
