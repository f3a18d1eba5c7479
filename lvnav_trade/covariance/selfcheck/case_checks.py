"""All checks of one case."""

from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events
from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.covariance.selfcheck.draw_checks import imu_checks, initial_error_checks
from lvnav_trade.covariance.selfcheck.innovation_checks import innovations
from lvnav_trade.covariance.selfcheck.jacobians import jacobians
from lvnav_trade.covariance.selfcheck.measured import measurement_checks
from lvnav_trade.covariance.selfcheck.state_checks import propagation, round_trip
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare


def check_scenario(scenario: Scenario, seed: int, history: float = 1.0) -> list[CheckResult]:
    """Return all checks of a scenario; statistical checks have no bounds yet (`check.set_bounds`).

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


def check_prepared(prepared_case: PreparedCase, seed: int) -> list[CheckResult]:
    """Return all checks of a prepared case, as `check_scenario`."""
    history = covariance(prepared_case)
    return [
        *round_trip(prepared_case),
        *jacobians(prepared_case),
        *propagation(prepared_case, history, flight_events(prepared_case)),
        *innovations(prepared_case, history, seed),
        *initial_error_checks(prepared_case, seed),
        *imu_checks(prepared_case, seed),
        *measurement_checks(prepared_case, seed),
    ]
