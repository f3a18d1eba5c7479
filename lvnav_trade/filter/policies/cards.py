"""Card of the mode logic of a filter: start, acceptance of samples, stop and restart."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import FLAGS, FRESH

CHECKS = (*FLAGS, FRESH)
if TYPE_CHECKING:
    Check = str
else:
    Check = Literal[CHECKS]
AfterStop = Literal["inertial", "held", "predicted"]
AFTER_STOP: tuple[AfterStop, ...] = ("inertial", "held", "predicted")  # in the order of the numbers in monitor.py
Persisting = Literal["data_loss", "residual", "covariance"]


class LogicCard(units.Card):
    """Rules of a mode logic: start, acceptance of samples, stop and restart. A rule that is not set is off."""

    check_flags: Annotated[tuple[Check, ...], AfterValidator(units.distinct)] = Field(
        CHECKS,
        description="reject output that the receiver marks as invalid by these flags; fresh: reject output that is "
        "repeated; true: all, false: none",
    )
    pdop_below: float | None = Field(None, gt=0, description="reject solutions with a larger dilution of precision")
    wild_position: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None,
        description="reject a sample if an axis differs from the prediction by more; before the start, from the "
        "previous sample",
    )
    wild_velocity: Annotated[units.Speed, Field(gt=0.0)] | None = None  # the same for velocity
    start_after: int = Field(1, ge=1, description="consecutive good samples before the filter starts")
    correct_after: units.Pause = Field(
        0.0,
        description="time after the start until corrections are applied; before that, outputs are those of the "
        "inertial system",
    )
    stop_after: units.TimeConstant | None = Field(
        None, description="time for which an error persists before the filter stops: data loss, residual, covariance"
    )
    after_stop: AfterStop = Field(
        "inertial",
        description="outputs of an open loop after a stop until it corrects again: those of the inertial system; these "
        "plus the last correction, held constant; these plus the last correction, propagated by the transition",
    )
    covariance_position: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None, description="a larger one-sigma, or one that is not a number, is a covariance error"
    )
    covariance_velocity: Annotated[units.Speed, Field(gt=0.0)] | None = None  # the same for velocity
    restart_after: tuple[Persisting, ...] = Field(
        ("data_loss", "residual", "covariance"),
        description="errors after which the filter restarts when samples are good",
    )

    @field_validator("check_flags", mode="before")
    @classmethod
    def _all_or_none(cls, given: Any) -> Any:
        """Return all checks for true, none for false."""
        return {True: CHECKS, False: ()}[given] if isinstance(given, bool) else given
