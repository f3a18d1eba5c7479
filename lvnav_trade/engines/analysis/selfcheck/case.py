"""All checks of one case."""

from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.analysis.selfcheck.check import Check
from lvnav_trade.engines.analysis.selfcheck.consistency import innovations
from lvnav_trade.engines.analysis.selfcheck.draws import of_imu, of_start
from lvnav_trade.engines.analysis.selfcheck.gaps import propagation
from lvnav_trade.engines.analysis.selfcheck.jacobians import jacobians
from lvnav_trade.engines.analysis.selfcheck.measured import of_measurements
from lvnav_trade.engines.analysis.selfcheck.states import round_trip
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.scenario import Scenario


def check_scenario(scenario: Scenario, seed: int, history: float = 1.0) -> list[Check]:
    """Return all checks of a scenario; statistical checks have no bounds yet (`check.bounded`).

    Parameters
    ----------
    scenario
        Validated model of the case.
    seed
        Seed of the campaign, so that the same campaign always has the same figures.
    history
        s. Interval of the history times.
    """
    return check_prepared(prepare(scenario, history), seed)


def check_prepared(prepared: Prepared, seed: int) -> list[Check]:
    """Return all checks of a prepared case, as `check_scenario`."""
    history = covariance(prepared)
    return [
        *round_trip(prepared),
        *jacobians(prepared),
        *propagation(prepared, history, flown_events(prepared)),
        *innovations(prepared, history, seed),
        *of_start(prepared, seed),
        *of_imu(prepared, seed),
        *of_measurements(prepared, seed),
    ]
