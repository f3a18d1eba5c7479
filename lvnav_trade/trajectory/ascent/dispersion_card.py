"""Dispersions of a launch vehicle: its spreads, and the dispersions of a mission."""

from collections.abc import Iterator
from typing import Annotated, Literal, get_args

from pydantic import Field

from lvnav_trade.quantities import units

Factor = Annotated[float, Field(gt=0.5, lt=2.0)]
SourceName = Literal[
    "thrust",
    "specific_impulse",
    "propellant",
    "dry_mass",
    "drag",
    "density",
    "wind",
    "thrust_misalignment",
    "separation_impulse",
    "ignition_delay",
    "tail_off",
]
SOURCES: tuple[SourceName, ...] = get_args(SourceName)


class DispersionsCard(units.NamedCard):
    """Dispersions of the vehicle and the atmosphere, one sigma; zero: none.

    Motors, stages and their separations are drawn independently.
    """

    thrust: units.Fraction = Field(0.0, description="one-sigma of the vacuum thrust of each motor")
    specific_impulse: units.Fraction = Field(0.0, description="one-sigma of the vacuum specific impulse of each motor")
    propellant: units.Fraction = Field(0.0, description="one-sigma of the usable propellant of each motor")
    dry_mass: units.Fraction = Field(0.0, description="one-sigma of the dry mass of each motor")
    drag: units.Fraction = Field(0.0, description="of the drag coefficient")
    density: units.Fraction = Field(0.0, description="one-sigma of the density of the air, equal at all heights")
    wind: units.SpeedSigma = Field(
        0.0, description="one-sigma of each horizontal wind component, a Gauss-Markov process over height"
    )
    wind_length: units.ScaleHeight = Field(5e3, description="correlation height of the wind")
    thrust_misalignment: units.AngleSigma = Field(
        0.0, description="between thrust and body, per axis, constant over a stage's burn"
    )
    separation_impulse: units.SpeedSigma = Field(
        0.0, description="one-sigma of the speed along the thrust that a separation adds to the remaining vehicle"
    )
    ignition_delay: units.Pause = Field(0.0, description="of the ignition of each stage above the first")
    tail_off: units.SpeedSigma = Field(0.0, description="one-sigma of the speed gained after the last cut-off")

    def _faults(self) -> Iterator[str]:
        if self.wind == 0.0 and self.wind_length != 5e3:
            yield "wind_length has no effect without wind; leave it out"


class Dispersion(units.Card):
    """Deviation of the simulated vehicle from the nominal vehicle, for which the steering is solved.

    Fixed deviations are factors common to all motors, or multiples of the vehicle's spreads. Drawn deviations differ
    between runs. A motor burns until its propellant is depleted. Without guidance steering and times are nominal, so
    that the orbit error is not corrected.
    """

    thrust: Factor = Field(1.0, description="factor on the vacuum thrust of all motors")
    specific_impulse: Factor = Field(1.0, description="factor on the vacuum specific impulse of all motors")
    mass: Factor = Field(1.0, description="factor on all dry masses: stages, boosters, fairing, payload")
    pitch_program: units.Angle = Field(
        0.0,
        description="pitch error, nose up: subtracted from the kick and added to the elevation of the steered burns",
    )
    sigmas: dict[SourceName, float] = Field(
        {},
        description="fixed multiples of the sigmas in vehicle.dispersions; requires guidance",
        json_schema_extra={"digest_if_set": True},
    )
    draw: Literal["none", "all"] | tuple[SourceName, ...] = Field(
        "none",
        description="sources in vehicle.dispersions that every run draws; requires guidance",
        json_schema_extra={"digest_if_set": True},
    )

    def _faults(self) -> Iterator[str]:
        if not self.is_common and not self.sigmas and not self.drawn_sources:
            yield (
                "changes nothing: give thrust, specific_impulse, mass or pitch_program, with guidance sigmas or draw, "
                "or leave it out"
            )
        for name in self.sigmas:
            if abs(self.sigmas[name]) > 6.0:
                yield f"sigmas.{name}: a dispersion beyond six sigma is another vehicle"

    @property
    def is_common(self) -> bool:
        """Whether common factors or the pitch programme differ from nominal."""
        return (self.thrust, self.specific_impulse, self.mass, self.pitch_program) != (1.0, 1.0, 1.0, 0.0)

    @property
    def drawn_sources(self) -> tuple[SourceName, ...]:
        """Names of the spreads that are drawn in every run; `all`: all spreads of the vehicle above zero."""
        if self.draw == "all":
            return SOURCES
        return () if self.draw == "none" else self.draw

    def misfits(self, spreads: DispersionsCard | None) -> Iterator[str]:
        """Yield the input errors of settings that need a spread of the vehicle that is missing."""
        named_sources = {*self.sigmas, *(self.draw if isinstance(self.draw, tuple) else ())}
        if spreads is None and (named_sources or self.drawn_sources):
            yield "dispersion draws from vehicle.dispersions, which the vehicle does not have; give them"
            return
        for name in SOURCES:
            if name in named_sources and getattr(spreads, name) == 0.0:
                yield f"dispersion names {name}, whose spread in vehicle.dispersions is zero"
