"""From a constellation card to satellites that can be asked where they are."""

from __future__ import annotations

from typing import Protocol

from lvnav_trade.records import Floats
from lvnav_trade.world.constellation import Constellation, orbits


class Satellites(Protocol):
    """A set of satellites around one lift-off, whatever their orbits are computed from.

    names (n_sat,) such as "G05"; systems (n_sat,) letters as in RINEX: G (GPS), E (Galileo), R (GLONASS).
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names, (n_sat,)."""

    @property
    def systems(self) -> tuple[str, ...]:
        """Letters of the systems, (n_sat,)."""

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        t (..., n_sat) or (..., 1) s of GPS time since the lift-off.
        """


def satellites(constellation: Constellation, epoch: str) -> Satellites:
    """Return the usable satellites of a constellation around a lift-off at `epoch` (ISO 8601, UTC).

    Raises
    ------
    InputError
        Where a file is broken (``file:line: what``), holds no healthy satellite, or a time cannot be read.
    """
    return orbits(constellation, epoch)
