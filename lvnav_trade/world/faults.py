"""Faults that a campaign names: what fails, when."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lvnav_trade.units import Card, Duration


class SatelliteOutage(Card):
    """All satellites lost, or all but `keep` (the highest at the start of the outage)."""

    kind: Literal["satellite_outage"] = "satellite_outage"
    start: str = Field(description="time such as '100 s', or relative to an event: 'stage1_cutoff + 20 s'")
    duration: Duration
    keep: int = Field(0, ge=0)
