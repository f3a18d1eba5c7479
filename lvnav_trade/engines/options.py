"""Parts of a flight that not every case has, from the cards: a receiver that solves itself, late measurements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.inputs import Schedule
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.filters.base import ReceiverBelief
from lvnav_trade.filters.late import Late
from lvnav_trade.filters.scheduled import Gains, gains_at
from lvnav_trade.layout import StateLayout, state_names
from lvnav_trade.receivers.base import (
    Solver,
    Told,
    constant_covariance,
    filter_model,
    own_covariance,
    point_model,
)
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario, epoch_interval, solves
from lvnav_trade.world.receiver.solutions import BancroftSolution, DirectSolution, FilteredSolution, OwnCovariance

Ints = NDArray[np.int64]


def direct(scenario: Scenario) -> DirectSolution:
    """Return what is true of a simulated solution; a tight filter behind a solving receiver takes none."""
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution):
        return card
    return DirectSolution.model_construct(position_sigma=0.0, velocity_sigma=0.0)


def every(scenario: Scenario) -> int:
    """Return of how many epochs the filter takes the last."""
    return round(scenario.receiver.rate / scenario.filter.update_rate) if solves(scenario) else 1


def gains_of(scenario: Scenario, layout: StateLayout, t_epoch: Floats, events: Mapping[str, float]) -> Gains | None:
    """Return the gains of a filter with a schedule at the epochs (s), None without.

    InputError where the schedule is of other states than the filter's, or of an event that the flight lacks.
    """
    schedule = scenario.filter.gains
    if schedule is None:
        return None
    names = state_names(layout)
    if tuple(schedule.states) != names:
        raise _about(
            "filter.gains",
            f"the schedule {schedule.name!r} is of the states {', '.join(schedule.states)}; the filter has "
            f"{', '.join(names)}",
        )
    try:
        return Gains(np.ascontiguousarray(gains_at(schedule, t_epoch, events)))
    except ValueError as error:
        raise _about("filter.gains", str(error)) from None


def _about(path: str, message: str) -> InputError:
    """Return the mistake in a field of the scenario."""
    return InputError(records=[Mistake(message, path)])


def _told(card: BancroftSolution | FilteredSolution, scenario: Scenario, belief: ReceiverBelief) -> Told:
    """Return the covariance that goes out with a solution; a filter that has numbers of its own believes those."""
    if not isinstance(scenario.filter.receiver, str):
        return constant_covariance(belief.position_sigma, belief.velocity_sigma)
    told = card.reported_covariance
    if isinstance(told, OwnCovariance):
        return own_covariance(told.factor, told.correlated)
    return constant_covariance(told.position_sigma, told.velocity_sigma)


def solver_of(scenario: Scenario, belief: ReceiverBelief, most: int) -> Solver | None:
    """Return how the receiver of a case solves, None where it does not; `most` satellites at once."""
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution) or not solves(scenario):
        return None
    told = _told(card, scenario, belief)
    if isinstance(card, BancroftSolution):
        return Solver(point_model(told, **card.numbers(), most=most))
    point = point_model(told, **card.fix.numbers(), most=most)
    return Solver(point, filter_model(told, epoch_interval(scenario), **card.numbers()))


def delay_taken(scenario: Scenario, t_epoch: Floats, t_valid: Floats) -> Floats | None:
    """Return the delay (n_epoch,) that the filter compensates; None where it does not.

    t_valid (n_epoch,): when the measurements of the epochs are of, as the receiver stamps them. InputError where the
    state of that time would lack the corrections of the epoch before.
    """
    card = scenario.filter.delay_compensation
    if card is None or not scenario.filter.aided:
        return None
    delay = t_epoch - t_valid if isinstance(card.delay, str) else np.full(t_epoch.size, card.delay)
    before = card.base if card.kind == "extrapolated" else 0.0
    worst = int(np.argmax(delay)) if delay.size else 0
    if delay.size and delay[worst] + before >= epoch_interval(scenario):
        raise _about(
            "filter.delay_compensation",
            f"a delay of {delay[worst] * 1e3:.0f} ms at {t_epoch[worst]:.0f} s"
            f"{f' and a base of {before * 1e3:.0f} ms' if before else ''}, not less than the "
            f"{epoch_interval(scenario) * 1e3:.0f} ms between epochs",
        )
    return delay


def late_of(scenario: Scenario, delay: Floats | None, at: Kept | None, schedule: Schedule) -> Late | None:
    """Return how late measurements are met; None where they are not compensated."""
    card = scenario.filter.delay_compensation
    if card is None or delay is None or at is None:
        return None
    ends = np.where(schedule.n_tick > 0, schedule.first_tick + schedule.n_tick, -1)
    return Late(
        extrapolated=card.kind == "extrapolated",
        valid=_epoch_at(ends, at.valid),
        early=_epoch_at(ends, at.early),
        delay=delay,
        offset=at.offset,
        base=at.base,
        interval=epoch_interval(scenario),
        jitter=card.delay_sigma**2,
        acceleration=card.acceleration_sigma**2,
    )


def _epoch_at(ends: Ints, ticks: Ints) -> Ints:
    """Return the epoch (n_window,) whose tick a window ends at, -1 none."""
    found = np.full(ends.size, -1, dtype=np.int64)
    number = {int(tick): epoch for epoch, tick in enumerate(ticks)}
    for window, end in enumerate(ends.tolist()):
        found[window] = number.get(end, -1)
    return found


class Kept(NamedTuple):
    """Ticks at whose end the state of an epoch's measurement is kept, and its velocity before; offset (n_epoch,) s from
    the tick to the time of validity, base (n_epoch,) s from the earlier tick to it.
    """

    valid: Ints
    early: Ints
    offset: Floats
    base: Floats


def kept_at(scenario: Scenario, t_epoch: Floats, delay: Floats | None, t: Floats, group: int) -> Kept | None:
    """Return when states are kept; t (n_tick + 1,) s of the ticks, a step of the strapdown is `group` of them."""
    card = scenario.filter.delay_compensation
    if card is None or delay is None:
        return None
    dt, wanted = float(t[1] - t[0]), t_epoch - delay
    valid = np.maximum(group, np.rint((wanted - t[0]) / (dt * group)).astype(np.int64) * group)
    early = np.maximum(0, valid - max(1, round(card.base / (dt * group))) * group)
    offset = wanted - t[valid]
    # what is left of rounding is not worth a step
    offset = np.where(np.abs(offset) < 1e-6 * dt, 0.0, offset)
    return Kept(valid, early, offset, wanted - t[early])
