"""Rules of the mode logic as numbers, and the receiver's own checks of every sample."""

import math
from collections.abc import Callable

import numpy as np

from lvnav_trade.engines.setup.inputs import Signals
from lvnav_trade.engines.setup.receiver.solution import Chain
from lvnav_trade.filters.base import FilterCard
from lvnav_trade.filters.integrity.card import IntegrityCard, thresholds_of
from lvnav_trade.filters.integrity.state import Tests
from lvnav_trade.filters.logic import CHECKS, LogicCard
from lvnav_trade.filters.model import FilterModel
from lvnav_trade.filters.monitor import DATA_LOST, Rules
from lvnav_trade.observables.partials import Channels
from lvnav_trade.records import FIRST_CHECK, Floats, Ints
from lvnav_trade.world.faults import Failures

_ERRORS = ("data_loss", "residual", "covariance")
_UNGUARDED = LogicCard(check_flags=())


def failing(
    card: FilterCard, failed: Failures, n_used: Ints, channels: Channels, dilution: Callable[[], Floats]
) -> Ints:
    """Return which check at the input the receiver's samples fail, by its number in `records.REASONS`, (n_epoch,): the
    first that they fail, 0 where none.

    Parameters
    ----------
    failed : what faults do to flags and freshness
    n_used : (n_epoch,) satellites in use
    dilution : of precision (n_epoch,); called where a rule is about it
    """
    logic = card.logic or _UNGUARDED
    wrong = [*failed.invalid.T, failed.frozen]
    checks = [(FIRST_CHECK + k, wrong[k]) for k, name in enumerate(CHECKS) if name in logic.check_flags]
    if logic.pdop_below is not None:
        checks.append((FIRST_CHECK + len(CHECKS), ~(dilution() < logic.pdop_below)))
    found = np.where(n_used >= (1 if channels.tight else 4), 0, DATA_LOST)
    for number, fails in checks:
        found[(found == 0) & fails] = number
    return found


def watched(card: FilterCard, failing: Ints, channels: Channels, P: Floats) -> Rules | None:
    """Return the rules of a filter card, None where it has no logic and starts as its card says.

    Parameters
    ----------
    failing : (n_epoch,) which check at the input fails, 0 where none
    P : (n_state, n_state) the filter's covariance at a start
    """
    if card.logic is None and card.init == "from_card":
        return None
    logic = card.logic or _UNGUARDED
    position, velocity = logic.wild_position or math.inf, logic.wild_velocity or math.inf
    return Rules(
        interval=1.0 / card.update_rate,
        good=failing == 0,
        limits=np.tile([position, velocity, *[math.inf] * len(channels.further)], len(channels.satellites))
        if channels.tight
        else np.repeat([position, velocity], 3),
        spread=np.repeat(np.square((logic.covariance_position or math.inf, logic.covariance_velocity or math.inf)), 3),
        start_after=float(logic.start_after),
        correct_after=logic.correct_after,
        stop_after=logic.stop_after or math.inf,
        restarts=np.array([float(error in logic.restart_after) for error in _ERRORS]),
        from_gnss=card.init == "from_gnss",
        P=P,
    )


def integrity_of(card: IntegrityCard, signals: Signals, model: FilterModel, rate: float) -> Tests:
    """Return the tests for faults: as many as the receiver has rows on the nominal flight."""
    per_epoch = model.n_kind * signals.n_used if model.tight else np.where(signals.n_used >= 4, 6, 0)
    return thresholds_of(card, int(np.sum(per_epoch)), signals.used.shape[1], 1.0 / rate)


def satellites_taken(rules: Rules | None, n_used: Ints, chain: Chain | None) -> Ints:
    """Return how many satellites the filter takes at the epochs, (n_epoch,): none where a sample fails the checks at
    the input, so that linear covariance has no row there either.

    n_used : (n_epoch,) satellites that the receiver uses
    chain : of a receiver that solves for itself, which goes on whatever the filter leaves out
    """
    return n_used if rules is None or chain is not None else np.where(rules.good, n_used, 0)
