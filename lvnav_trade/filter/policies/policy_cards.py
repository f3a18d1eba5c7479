"""Cards of the filter's mode logic and of its tests for faults."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator
from scipy.special import chdtri

from lvnav_trade.filter.policies.integrity.state import FaultTests
from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import FLAGS, FRESH

CHECKS = (*FLAGS, FRESH)
if TYPE_CHECKING:
    Check = str
else:
    Check = Literal[CHECKS]
AfterStop = Literal["inertial", "held", "predicted"]
AFTER_STOP: tuple[AfterStop, ...] = ("inertial", "held", "predicted")  # in the order of the numbers in mode_logic.py
PersistentError = Literal["data_loss", "residual", "covariance"]


class LogicCard(units.Card):
    """Rules of a mode logic: start, acceptance of samples, stop and restart. A rule that is not set is off."""

    check_flags: Annotated[tuple[Check, ...], AfterValidator(units.require_distinct)] = Field(
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
    restart_after: tuple[PersistentError, ...] = Field(
        ("data_loss", "residual", "covariance"),
        description="errors after which the filter restarts when samples are good",
    )

    @field_validator("check_flags", mode="before")
    @classmethod
    def _expand_flags(cls, setting: Any) -> Any:
        """Return all checks for true, none for false."""
        return {True: CHECKS, False: ()}[setting] if isinstance(setting, bool) else setting


class IntegrityCard(units.Card):
    """Tests of innovations for faults: thresholds by chi-square of the predicted innovation."""

    false_alarm: units.Share = Field(
        1e-3, gt=0.0, lt=1.0, description="largest probability of an alarm in a run without faults"
    )
    isolation: units.Share = Field(1e-3, gt=0.0, lt=1.0, description="level of the tests that isolate a detected fault")
    window: int = Field(5, ge=2, le=50, description="epochs of a channel that are tested together")
    hold: units.Pause = Field(10.0, description="time for which a satellite stays excluded, or a solution is rejected")
    exclusions: int = Field(2, ge=1, le=6, description="largest number of satellites excluded at one epoch")
    recovery: float = Field(
        3.0, gt=0.0, description="sigma of the inflation, as a multiple of the shift that was found"
    )


def build_fault_tests(card: IntegrityCard, n_test: int, max_satellite_count: int, interval: float) -> FaultTests:
    """Return the thresholds of the tests.

    Parameters
    ----------
    card
        Levels of the tests.
    n_test
        Number of scalar measurements on the nominal flight. Each is tested twice: alone and within its window.
    max_satellite_count
        Largest number of satellites in use at once.
    interval
        s. Time between epochs.

    Notes
    -----
    The level of one test is the false-alarm probability of the flight divided by the number of tests (Bonferroni). The
    thresholds are chi-square quantiles of that level, or of the isolation level.
    """
    level = card.false_alarm / (2 * max(1, n_test))
    freedom = np.arange(1, max(2, max_satellite_count))
    return FaultTests(
        single_limit=float(chdtri(1, level)),
        window_limit=float(chdtri(card.window, level)),
        window=card.window,
        residual_limits=np.concatenate([[np.inf], chdtri(freedom, card.isolation)]),
        shift_limit=float(chdtri(3, card.isolation)),
        joint_limit=float(chdtri(4, card.isolation)),
        clock_limit=float(chdtri(1, card.isolation)),
        hold=max(1.0, float(np.ceil(card.hold / interval - 1e-9))),
        exclusions=card.exclusions,
        recovery=card.recovery,
        interval=interval,
    )
