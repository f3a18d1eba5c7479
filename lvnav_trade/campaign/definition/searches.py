"""Searches that a campaign may request: inverse problem (solve), sensitivity indices, filter tuning."""

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from lvnav_trade.quantities import units


class Vary(units.Card):
    """A field of the base scenario to search, between two values or over a list of values."""

    path: str = Field(description="field of the base scenario, dotted: initial.heading, imu.gyro.bias_repeatability")
    between: tuple[Any, Any] | None = Field(None, description="[least, largest], numbers or quantities in one unit")
    values: tuple[Any, ...] | None = Field(
        None, description="or a list of increasing numbers or quantities in one unit"
    )
    log: bool = Field(False, description="search on a logarithmic scale")
    points: int = Field(
        9, ge=3, le=100, description="number of points that are evaluated first; crossings are searched between them"
    )

    def _faults(self) -> Iterator[str]:
        if (self.between is None) == (self.values is None):
            yield "vary has either between or values"
        if self.values is not None and (self.log or len(self.values) < 2):
            yield "give two values or more, and no log"


Total = Literal["cost", "mass", "power", "volume"]


class Solve(units.Card):
    """The largest value of a field that meets the requirements (of two fields: for each value of the second), or the
    least expensive case that meets them.
    """

    vary: tuple[Vary, ...] = Field((), max_length=2)
    least: Total | None = Field(
        None, description="or: find the case that meets the requirements with the smallest total of this kind"
    )
    meet: tuple[str, ...] = Field((), description="names of the requirements; all if absent")
    margin: units.Share = Field(
        0.1, gt=0, lt=1, description="margin m: runs are made at the answer divided by and multiplied by 1 + m"
    )

    def _faults(self) -> Iterator[str]:
        if bool(self.vary) == (self.least is not None):
            yield "solve has either vary or least"
        if self.least is not None and "margin" in self.model_fields_set:
            yield "margin has no effect: with least, runs simulate the case itself; leave it out"


class Indices(units.Card):
    """Global sensitivity of one requirement's error to the sigmas of the largest error sources."""

    requirement: str = Field("", description="requirement whose error is analysed; the first if absent")
    sources: int = Field(10, ge=2, le=20, description="number of sources, the largest of the error budget")
    factor: float = Field(
        2.0, gt=1, description="factor on each sigma: between 1/factor and factor, uniform in the logarithm"
    )
    samples: int = Field(256, ge=16, le=4096, description="linear covariances with the filter re-tuned")


class Variable(units.Card):
    """A field of the filter that is tuned between two values, in the logarithm."""

    path: str = Field(
        description="field of the filter: filter.attitude_noise, filter.gate, filter.receiver.pseudorange_sigma"
    )
    between: tuple[Any, Any]


class Tune(units.Card):
    """Settings of a filter that minimise an error over several cases at once."""

    variables: tuple[Variable, ...] = Field(min_length=1, max_length=8)
    requirement: str = Field("", description="requirement whose error is minimised; the first if absent")
    over: Literal["worst", "mean"] = Field(
        "worst", description="objective over the cases: the largest ratio of error to limit, or the mean"
    )
    nees: tuple[float, float] | None = Field(
        None, description="bounds of the expected normalised error squared at the requirement's event, per state"
    )
    hold_out: tuple[str, ...] = Field(
        (), description="labels of cases that are not used in the search and validate its result"
    )
    evaluations: int = Field(120, ge=10, le=2000, description="largest number of evaluations of all cases")

    def _faults(self) -> Iterator[str]:
        paths = [variable.path for variable in self.variables]
        for path in sorted(set(paths)):
            if paths.count(path) > 1:
                yield f"variables: {path} is stated {paths.count(path)} times; state it once"
