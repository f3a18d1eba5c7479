"""Card of a filter's mode logic: when it starts, which samples it accepts, when it stops and starts again."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator

from lvnav_trade import units
from lvnav_trade.records import FLAGS, FRESH

CHECKS = (*FLAGS, FRESH)
if TYPE_CHECKING:
    Check = str
else:
    Check = Literal[CHECKS]
Persisting = Literal["data_loss", "residual", "covariance"]


class LogicCard(units.Card):
    """When a filter starts, what it accepts, when it gives up and starts again; a rule that is left out is off."""

    check_flags: Annotated[tuple[Check, ...], AfterValidator(units.distinct)] = Field(
        CHECKS,
        description="leave out what the receiver marks as invalid by these flags; fresh: what it put out before. true: "
        "all, false: none",
    )
    pdop_below: float | None = Field(None, gt=0, description="leave out solutions of a greater dilution of precision")
    wild_position: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None,
        description="leave out a sample of which an axis is further from the prediction; before a start, further "
        "from the sample before",
    )
    wild_velocity: Annotated[units.Speed, Field(gt=0.0)] | None = None  # the same for velocity
    start_after: int = Field(1, ge=1, description="good samples in a row")
    correct_after: units.Pause = Field(0.0, description="since its start the outputs are the inertial system's own")
    stop_after: units.TimeConstant | None = Field(None, description="of any error: data loss, residual, covariance")
    covariance_position: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None, description="a one-sigma beyond is an error of the covariance; so is one that is no number"
    )
    covariance_velocity: Annotated[units.Speed, Field(gt=0.0)] | None = None  # the same for velocity
    restart_after: tuple[Persisting, ...] = Field(
        ("data_loss", "residual", "covariance"), description="errors after which it starts again with good samples"
    )

    @field_validator("check_flags", mode="before")
    @classmethod
    def _all_or_none(cls, given: Any) -> Any:
        """Return all checks for true, none for false."""
        return {True: CHECKS, False: ()}[given] if isinstance(given, bool) else given
