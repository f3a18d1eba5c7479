"""Cards that several rooms use: resources of a device, factors on noise, limits of the vehicle's motion."""

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np
from pydantic import Field

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Bools, Floats
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
    def independent_quantity(self) -> str:
        """The independent variable of the table, one of `QUANTITIES`."""
        return next(name for name in QUANTITIES if getattr(self, name))

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        given_names = [name for name in QUANTITIES if getattr(self, name)]
        if len(given_names) != 1:
            yield f"one of {', '.join(QUANTITIES)} is stated, not {' and '.join(given_names) or 'none'}"
            return
        values = getattr(self, self.independent_quantity)
        require_rising(self.independent_quantity, values)
        yield from self._length_faults(values)

    def _length_faults(self, values: tuple[float, ...]) -> Iterator[str]:
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

    def _length_faults(self, values: tuple[float, ...]) -> Iterator[str]:
        if len(values) != len(self.factor):
            yield f"{len(values)} values of {self.independent_quantity} but {len(self.factor)} factors"


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


def noise_factor(tables: Sequence[NoiseFactor], measurement: str, dynamics: Dynamics) -> Floats:
    """Return the factor (n,) on the sigma of a measurement: the product over all tables of that measurement.

    Parameters
    ----------
    tables : sequence of NoiseFactor
    measurement : str
        One of `NOISY`.
    dynamics : Dynamics
        Altitude, specific force and jerk at n times.
    """
    factor = np.ones(dynamics.altitude.size)
    for table in tables:
        if measurement not in table.of:
            continue
        for name in QUANTITIES:
            points = getattr(table, name)
            if points:
                values = getattr(dynamics, name)
                factor = factor * np.interp(values, points, table.factor)
    return factor


def idle_tables(tables: Sequence[NoiseFactor], measurements: Collection[str]) -> list[int]:
    """Return the indices of the tables whose measurements the filter does not use."""
    processed_measurements = set(measurements)
    return [number for number, table in enumerate(tables) if not set(table.of) & processed_measurements]


class EnvelopeCard(units.Card):
    """Standard deviations of the steps of rate and acceleration (random walks), by phase and by command.

    Pitch and yaw: |gain / (time s + 1) commanded angular acceleration| plus the unknown part in burns or coasts.
    Lateral jerk: |gain / (time s + 1) rate of the commanded nozzle angle| plus the unknown part. The numbers are those
    of Beaudoin, Desbiens, Gagnon and Landry, section 2.3 (equations 7 to 10).
    """

    roll: units.AngularAccelerationSigma = 0.002  # roll acceleration
    burn: units.AngularAccelerationSigma = 0.02  # unknown pitch and yaw acceleration in burns
    coast: units.AngularAccelerationSigma = 0.002  # unknown pitch and yaw acceleration in coasts
    turn_gain: float = Field(5.0, ge=0.0)  # gain on the commanded angular acceleration
    turn_time: units.TimeConstant = 2.0  # time constant of the response to that command
    axial_burn: units.JerkSigma = 15.0  # axial jerk in burns
    axial_coast: units.JerkSigma = 10.0  # axial jerk in coasts
    axial_change: units.JerkSigma = 15000.0  # axial jerk around ignition, cut-off and separation
    before_change: units.Pause = 1.0  # time before such a change for which it is assumed
    after_change: units.Pause = 2.0  # time after such a change for which it is assumed
    lateral: units.JerkSigma = 10.0  # unknown lateral jerk
    nozzle_gain: units.AccelerationSigma = 30.0  # lateral acceleration per nozzle angle
    nozzle_time: units.TimeConstant = 0.035  # time constant of the response to the nozzle
    start_rate: units.AngularRateSigma = Field(
        0.017453292519943295, description="initial one-sigma of the rate, before the first sample"
    )
    start_acceleration: units.AccelerationSigma = Field(
        20.0, description="initial one-sigma of the acceleration, before the first sample"
    )


def is_changing(card: EnvelopeCard, t: Floats, changes: Floats) -> Bools:
    """Return whether each time t (n,) s lies within the window around a change of phase, `changes` (k,) s, rising."""
    begin = np.searchsorted(changes, t - card.after_change, side="left")
    end = np.searchsorted(changes, t + card.before_change, side="right")
    return np.asarray(end > begin)


def steady_ratio(driving: float, noise: float) -> float:
    """Return the steady-state variance of a scalar random walk after an update over the measurement variance.

    It equals the steady-state gain: (-x + sqrt(x^2 + 4 x)) / 2 with x = driving / noise.

    driving : Variance of a step of the random walk.
    noise : Variance of a measurement.
    """
    x = driving / noise
    root = math.sqrt(x * x + 4.0 * x)
    return 0.5 * (root - x)


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
