"""All checks of one case."""

from lvnav_trade.covariance.diagnostics.case_diagnostics import flown_events
from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.covariance.selfcheck.draw_checks import of_imu, of_start
from lvnav_trade.covariance.selfcheck.innovation_checks import innovations
from lvnav_trade.covariance.selfcheck.jacobians import jacobians
from lvnav_trade.covariance.selfcheck.measured import of_measurements
from lvnav_trade.covariance.selfcheck.state_checks import propagation, round_trip
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare


def check_scenario(scenario: Scenario, seed: int, history: float = 1.0) -> list[CheckResult]:
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


def check_prepared(prepared: Prepared, seed: int) -> list[CheckResult]:
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
