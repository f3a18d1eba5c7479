"""Card of a filter's tests for faults, and the tests in numbers."""

import numpy as np
from pydantic import Field
from scipy.special import chdtri

from lvnav_trade import units
from lvnav_trade.filters.integrity.state import Tests


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


def thresholds_of(card: IntegrityCard, n_test: int, most: int, interval: float) -> Tests:
    """Return the tests in numbers.

    n_test: rows of the nominal flight, each tested alone and within its window: the level of a test is the probability
    of a false alarm over the number of tests (Bonferroni). most: satellites in use at once; interval s of epochs.
    """
    level = card.false_alarm / (2 * max(1, n_test))
    freedom = np.arange(1, max(2, most))
    return Tests(
        single=float(chdtri(1, level)),
        windowed=float(chdtri(card.window, level)),
        window=card.window,
        consistent=np.concatenate([[np.inf], chdtri(freedom, card.isolation)]),
        shift=float(chdtri(3, card.isolation)),
        joint=float(chdtri(4, card.isolation)),
        offset=float(chdtri(1, card.isolation)),
        hold=max(1.0, float(np.ceil(card.hold / interval - 1e-9))),
        exclusions=card.exclusions,
        recovery=card.recovery,
        interval=interval,
    )
