"""White noise of a receiver over altitude, specific force or jerk: factors on its sigma, for truth and filter."""

from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from pydantic import Field

from lvnav_trade.records import Floats
from lvnav_trade.units import AccelerationSigma, Card, JerkSigma, Length, require_rising

Noisy = Literal["pseudorange", "range_rate", "carrier_phase", "position", "velocity"]
NOISY: tuple[Noisy, ...] = get_args(Noisy)
QUANTITIES = ("altitude", "specific_force", "jerk")


class OverFlight(Card):
    """Numbers over one quantity of the nominal flight.

    Straight lines join the entries, and the first and last value hold beyond them.
    """

    altitude: tuple[Length, ...] = Field((), description="above the ellipsoid, rising; one of three quantities")
    specific_force: tuple[AccelerationSigma, ...] = Field((), description="its size, rising")
    jerk: tuple[JerkSigma, ...] = Field((), description="size of the change of specific force over 0.1 s, rising")

    @property
    def over(self) -> str:
        """The quantity that they are over."""
        return next(name for name in QUANTITIES if getattr(self, name))

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        stated = [name for name in QUANTITIES if getattr(self, name)]
        if len(stated) != 1:
            yield f"one of {', '.join(QUANTITIES)} is stated, not {' and '.join(stated) or 'none'}"
            return
        values = getattr(self, self.over)
        require_rising(self.over, values)
        yield from self._unlike(values)

    def _unlike(self, values: tuple[float, ...]) -> Iterator[str]:
        """Yield what does not fit the values (n,) of the quantity."""
        return iter(())


class NoiseFactor(OverFlight):
    """A factor on the sigma of white noise over one quantity of the nominal flight.

    Two entries are a proportion with a least and a greatest noise. Factors of several tables multiply.
    """

    factor: tuple[Annotated[float, Field(gt=0.0)], ...] = Field(min_length=2, description="on sigma, at these values")
    of: tuple[Noisy, ...] = Field(NOISY, min_length=1, description="measurements whose noise it is")

    def _unlike(self, values: tuple[float, ...]) -> Iterator[str]:
        if len(values) != len(self.factor):
            yield f"{len(values)} values of {self.over} but {len(self.factor)} factors"


NoiseBy = Annotated[
    tuple[NoiseFactor, ...], Field(description="factors on the sigma of white noise over the flight; none: constant")
]


class Dynamics(NamedTuple):
    """What noise may depend on, at times of the nominal flight, (n,) each: altitude m above the ellipsoid, size of the
    specific force m/s^2 and of its change m/s^3.
    """

    altitude: Floats
    specific_force: Floats
    jerk: Floats


def noise_factor(tables: Sequence[NoiseFactor], measurement: str, at: Dynamics) -> Floats:
    """Return the factor (n,) on the sigma of a measurement: the product of all tables that are of it."""
    found = np.ones(at.altitude.size)
    for table in tables:
        if measurement in table.of:
            for name in QUANTITIES:
                if getattr(table, name):
                    found = found * np.interp(getattr(at, name), getattr(table, name), table.factor)
    return found


def idle_tables(tables: Sequence[NoiseFactor], measured: Collection[str]) -> list[int]:
    """Return the numbers of the tables of which no measurement is taken."""
    return [number for number, table in enumerate(tables) if not set(table.of) & set(measured)]
