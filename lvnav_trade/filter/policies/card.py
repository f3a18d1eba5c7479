"""Card of the fault detection of a filter, and its thresholds."""

import numpy as np
from pydantic import Field
from scipy.special import chdtri

from lvnav_trade.filter.policies.integrity.state import Tests
from lvnav_trade.quantities import units


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
    """Return the thresholds of the tests.

    Parameters
    ----------
    card
        Levels of the tests.
    n_test
        Number of scalar measurements on the nominal flight. Each is tested twice: alone and within its window.
    most
        Largest number of satellites in use at once.
    interval
        s. Time between epochs.

    Notes
    -----
    The level of one test is the false-alarm probability of the flight divided by the number of tests (Bonferroni). The
    thresholds are chi-square quantiles of that level, or of the isolation level.
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
