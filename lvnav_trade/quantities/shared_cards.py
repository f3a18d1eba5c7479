"""White noise of a receiver as a function of altitude, specific force or jerk: factors on sigma (truth and filter)."""

from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import AccelerationSigma, Card, JerkSigma, Length, require_rising

Noisy = Literal["pseudorange", "range_rate", "carrier_phase", "position", "velocity"]
NOISY: tuple[Noisy, ...] = get_args(Noisy)
QUANTITIES = ("altitude", "specific_force", "jerk")


class OverFlight(Card):
    """Table over one quantity of the nominal flight.

    Linear between entries, constant outside them.
    """

    altitude: tuple[Length, ...] = Field(
        (), description="heights above the ellipsoid, increasing; a table has one of three quantities"
    )
    specific_force: tuple[AccelerationSigma, ...] = Field(
        (), description="magnitudes of the specific force, increasing"
    )
    jerk: tuple[JerkSigma, ...] = Field(
        (), description="magnitudes of the change of specific force over 0.1 s, increasing"
    )

    @property
    def over(self) -> str:
        """The independent variable of the table, one of `QUANTITIES`."""
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
        """Yield the input errors of columns whose length differs from that of the values (n,)."""
        return iter(())


class NoiseFactor(OverFlight):
    """Factor on the sigma of white noise as a function of one quantity of the nominal flight.

    Two entries make a linear law with lower and upper limits. Factors of several tables multiply.
    """

    factor: tuple[Annotated[float, Field(gt=0.0)], ...] = Field(
        min_length=2, description="factors on sigma at these values"
    )
    of: tuple[Noisy, ...] = Field(NOISY, min_length=1, description="measurements to which the table applies")

    def _unlike(self, values: tuple[float, ...]) -> Iterator[str]:
        if len(values) != len(self.factor):
            yield f"{len(values)} values of {self.over} but {len(self.factor)} factors"


NoiseBy = Annotated[
    tuple[NoiseFactor, ...], Field(description="factors on the sigma of white noise over the flight; none: constant")
]


class Dynamics(NamedTuple):
    """Independent variables of the noise tables, at n times of the nominal flight.

    altitude : (n,) m. Above the ellipsoid.
    specific_force : (n,) m/s^2. Magnitude.
    jerk : (n,) m/s^3. Magnitude of the rate of change of specific force.
    """

    altitude: Floats
    specific_force: Floats
    jerk: Floats


def noise_factor(tables: Sequence[NoiseFactor], measurement: str, at: Dynamics) -> Floats:
    """Return the factor (n,) on the sigma of a measurement: the product over all tables of that measurement.

    Parameters
    ----------
    tables : sequence of NoiseFactor
    measurement : str
        One of `NOISY`.
    at : Dynamics
        Altitude, specific force and jerk at n times.
    """
    factor = np.ones(at.altitude.size)
    for table in tables:
        if measurement in table.of:
            for name in QUANTITIES:
                if getattr(table, name):
                    factor = factor * np.interp(getattr(at, name), getattr(table, name), table.factor)
    return factor


def idle_tables(tables: Sequence[NoiseFactor], measured: Collection[str]) -> list[int]:
    """Return the indices of the tables whose measurements the filter does not use."""
    return [number for number, table in enumerate(tables) if not set(table.of) & set(measured)]
