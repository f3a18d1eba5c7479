"""Rules of the mode logic as numbers, and checks of the receiver's samples at the input of the filter."""

import math
from collections.abc import Callable

import numpy as np

from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.model import FilterModel
from lvnav_trade.filter.policies.integrity.state import FaultTests
from lvnav_trade.filter.policies.mode_logic import DATA_LOST, ModeRules
from lvnav_trade.filter.policies.policy_cards import AFTER_STOP, CHECKS, IntegrityCard, LogicCard, build_fault_tests
from lvnav_trade.gnss.faults import FaultEffects
from lvnav_trade.quantities.records import FIRST_CHECK, Floats, Ints
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.simulation.preparation.inputs import Signals
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel

_ERRORS = ("data_loss", "residual", "covariance")
_UNGUARDED = LogicCard(check_flags=())


def failed_checks(
    card: FilterCard,
    failures: FaultEffects,
    n_used: Ints,
    channels: Channels,
    dilution: Callable[[], Floats],
) -> Ints:
    """Return the first input check that the receiver's sample fails at each epoch, (n_epoch,).

    It is a number of `records.REASONS`; 0 if the sample passes all checks.

    Parameters
    ----------
    card
        Filter card with the mode logic.
    failures
        Effects of faults on flags and freshness.
    n_used
        (n_epoch,). Number of satellites in use.
    channels
        Measurement channels.
    dilution
        Function that returns the dilution of precision (n_epoch,); called only if a rule needs it.
    """
    logic = card.logic or _UNGUARDED
    flags = [*failures.raised_flags.T, failures.is_frozen]
    checks = []
    for k, name in enumerate(CHECKS):
        if name in logic.check_flags:
            checks.append((FIRST_CHECK + k, flags[k]))
    if logic.pdop_below is not None:
        checks.append((FIRST_CHECK + len(CHECKS), ~(dilution() < logic.pdop_below)))
    n_needed = 1 if channels.tight else 4
    numbers = np.where(n_used >= n_needed, 0, DATA_LOST)
    for number, fails in checks:
        numbers[(numbers == 0) & fails] = number
    return numbers


def mode_rules_of(card: FilterCard, failed_check: Ints, channels: Channels, P: Floats) -> ModeRules | None:
    """Return the rules of a filter's mode logic; None without a mode logic and without a start from the receiver.

    Parameters
    ----------
    card
        Filter card.
    failed_check
        (n_epoch,). Input check that fails, 0 none; see `failed_checks`.
    channels
        Measurement channels.
    P
        (n_state, n_state) SI squared. Covariance of the filter at a start.
    """
    if card.logic is None and card.init == "from_card":
        return None
    logic = card.logic or _UNGUARDED
    position = logic.wild_position or math.inf
    velocity = logic.wild_velocity or math.inf
    if channels.tight:
        by_observable = [position, velocity, *[math.inf] * len(channels.further)]
        limits = np.tile(by_observable, len(channels.satellites))
    else:
        limits = np.repeat([position, velocity], 3)
    sigmas = (logic.covariance_position or math.inf, logic.covariance_velocity or math.inf)
    return ModeRules(
        interval=1.0 / card.update_rate,
        is_good=failed_check == 0,
        residual_limits=limits,
        variance_limits=np.repeat(np.square(sigmas), 3),
        start_after=float(logic.start_after),
        correct_after=logic.correct_after,
        stop_after=logic.stop_after or math.inf,
        after_stop=AFTER_STOP.index(logic.after_stop),
        restarts=np.array([float(error in logic.restart_after) for error in _ERRORS]),
        from_gnss=card.init == "from_gnss",
        start_covariance=P,
    )


def integrity_of(card: IntegrityCard, signals: Signals, model: FilterModel, rate: float) -> FaultTests:
    """Return the thresholds of the tests for faults.

    The number of tests is the number of scalar measurements of the receiver on the nominal flight.

    Parameters
    ----------
    card
        Levels of the tests.
    signals, model
        Satellites in use, and the filter.
    rate
        Hz. Update rate of the filter.
    """
    per_epoch = model.n_observable * signals.n_used if model.tight else np.where(signals.n_used >= 4, 6, 0)
    n_measurement = int(np.sum(per_epoch))
    n_slot = signals.satellite_by_slot.shape[1]
    interval = 1.0 / rate
    return build_fault_tests(card, n_measurement, n_slot, interval)


def used_satellite_count(rules: ModeRules | None, n_used: Ints, chain: SolutionErrorModel | None) -> Ints:
    """Return the number of satellites that the filter uses at the epochs, (n_epoch,).

    It is zero where a sample fails the input checks, so that linear covariance has no measurement there either.

    Parameters
    ----------
    rules
        Rules of the mode logic, or None.
    n_used
        (n_epoch,). Number of satellites that the receiver uses.
    chain
        Error propagation of a receiver that computes its solution; it continues with all satellites.
    """
    if rules is None or chain is not None:
        return n_used
    return np.where(rules.is_good, n_used, 0)
