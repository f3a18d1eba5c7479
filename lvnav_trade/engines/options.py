"""Parts of a flight that not every case has, from the cards: a receiver that solves for position and velocity."""

from __future__ import annotations

from lvnav_trade.errors import InputError
from lvnav_trade.filters.base import ReceiverBelief
from lvnav_trade.receivers.base import (
    Solver,
    Told,
    constant_covariance,
    filter_model,
    own_covariance,
    point_model,
)
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.solutions import BancroftSolution, DirectSolution, FilteredSolution, OwnCovariance


def solves(scenario: Scenario) -> bool:
    """Return whether a loose filter takes the solution of a receiver that solves for it itself."""
    return scenario.filter.kind == "loose" and not isinstance(scenario.receiver.solution, DirectSolution)


def direct(scenario: Scenario) -> DirectSolution:
    """Return what is true of a simulated solution; a tight filter behind a solving receiver takes none."""
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution):
        return card
    return DirectSolution.model_construct(position_sigma=0.0, velocity_sigma=0.0)


def epoch_interval(scenario: Scenario) -> float:
    """Return the time (s) between two epochs: a solving receiver works at its own rate, whatever the filter takes."""
    return 1.0 / (scenario.receiver.rate if solves(scenario) else scenario.filter.update_rate)


def every(scenario: Scenario) -> int:
    """Return of how many epochs the filter takes the last."""
    return round(scenario.receiver.rate / scenario.filter.update_rate) if solves(scenario) else 1


def refuse_contradiction(scenario: Scenario) -> None:
    """InputError where a filter behind a solving receiver is asked for what it cannot have."""
    if not solves(scenario):
        return
    card = scenario.filter
    extra = [name for name in (*card.extra_states, *card.consider) if name not in ("gyro_bias", "accel_bias")]
    shared = [name for name in extra if not name.startswith(("gyro_", "accel_"))]
    if shared:
        raise InputError(
            f"filter.extra_states: {', '.join(shared)}: a filter behind a solving receiver "
            f"(receiver.solution.kind: {scenario.receiver.solution.kind}) has no such state"
        )
    if any(fault.kind == "frozen_output" for fault in scenario.faults):
        raise InputError("faults: frozen_output needs receiver.solution.kind: direct, or a tight filter")


def _told(card: BancroftSolution | FilteredSolution, scenario: Scenario, belief: ReceiverBelief) -> Told:
    """Return the covariance that goes out with a solution; a filter that has numbers of its own believes those."""
    if not isinstance(scenario.filter.receiver, str):
        return constant_covariance(belief.position_sigma, belief.velocity_sigma)
    told = card.told
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
