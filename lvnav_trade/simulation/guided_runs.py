"""Injection of guided runs: the orbits that dispersed vehicles reach with the navigation errors of the runs.

Navigation errors are those along the nominal flight; their change on a dispersed flight is of second order (see
docs/decisions/0083-a-guided-run-flies-the-errors-of-the-nominal-flight.md).
"""

import numpy as np

from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import NO_INJECTIONS, NO_LOST, OUTCOMES, Floats
from lvnav_trade.simulation.preparation.prepared_case import PreparedCase
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES
from lvnav_trade.trajectory.guided.ascent_runs import Injection, inject
from lvnav_trade.trajectory.guided.autopilot import DrawKeys
from lvnav_trade.trajectory.guided.draws import draw
from lvnav_trade.trajectory.guided.guidance_plan import steering_times
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.orbit_numbers import orbit_difference, osculating_orbit
from lvnav_trade.trajectory.guided.pilots import INJECTED

_N_MOTION = 9  # outputs that every case begins with: attitude, velocity, position


def injections(prepared_case: PreparedCase, seed: int, first_run: int, errors: Floats) -> tuple[Floats, Floats]:
    """Return the injections of guided runs, and the draws of lost vehicles; empty without guidance.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    first_run
        Number of the first run.
    errors
        (n_run, n_hist, n_out) SI. Navigation errors at the history times, reporting axes.

    Returns
    -------
    injections
        (n_run, 3 + 2 n_orbit). As in `RunBlock.injections`.
    lost_draws
        (n, 4). As in `RunBlock.lost_draws`.
    """
    plan = prepared_case.plan
    if plan is None:
        return NO_INJECTIONS, NO_LOST
    steering = steering_times(plan, prepared_case.record.t)
    t = prepared_case.record.t[steering]
    k0, k1 = seed_words(seed)
    results: list[Injection] = []
    lost_draws: list[tuple[float, ...]] = []
    inertial_errors = inertial_errors_of(prepared_case, errors)
    for run, error in enumerate(inertial_errors, start=first_run):
        draws = draw(plan.card, seed, run)
        navigation = NavigationErrors(t, error[steering])
        keys = DrawKeys(k0, k1, np.uint64(run))
        result = inject(plan, draws, navigation, keys)
        results.append(result)
        if result.outcome == INJECTED:
            continue
        for name, values in draws.items():
            source = SOURCES.index(name)
            lost_draws += [(run, source, number, value) for number, value in enumerate(values)]
    return injection_rows(results, plan.nominal), np.array(lost_draws, dtype=float).reshape(-1, 4)


def inertial_errors_of(prepared_case: PreparedCase, errors: Floats) -> Floats:
    """Return the errors of attitude, velocity and position in frame i, (n_run, n_hist, 9) rad, m/s, m.

    Parameters
    ----------
    prepared_case
        Prepared case.
    errors
        (n_run, n_hist, n_out). Attitude in body axes, velocity and position in the reporting frame.
    """
    record = prepared_case.record
    n_run, n_hist = errors.shape[:2]
    motion_errors = errors[..., :_N_MOTION]
    by_quantity = motion_errors.reshape(n_run, n_hist, 3, 3)
    C_b_i = matrices(record.q)
    attitude = np.einsum("hij,rhj->rhi", C_b_i, by_quantity[:, :, 0])
    velocity_and_position = np.einsum("hji,rhpj->rhpi", record.axes, by_quantity[:, :, 1:])
    blocks = [attitude[:, :, None], velocity_and_position]
    inertial_errors = np.concatenate(blocks, axis=2)
    return inertial_errors.reshape(n_run, n_hist, _N_MOTION)


def injection_rows(injections: list[Injection], nominal: Floats) -> Floats:
    """Return injections as in `RunBlock.injections`; nominal: (7,) nominal state at cut-off, the target."""
    y = np.stack([item.y for item in injections])
    error = np.stack([item.error for item in injections])
    target = osculating_orbit(nominal[None])[0]
    achieved_orbit = osculating_orbit(y)
    # the navigated state: position and velocity without the navigation errors, which are velocity first
    position_and_velocity_error = error[:, [6, 7, 8, 3, 4, 5]]
    navigated_orbit = osculating_orbit(y[:, :6] - position_and_velocity_error)
    outcomes = np.array([[OUTCOMES.index(item.outcome), item.t, item.propellant_left] for item in injections])
    from_target = orbit_difference(achieved_orbit, target)
    from_navigated = orbit_difference(achieved_orbit, navigated_orbit)
    return np.concatenate([outcomes, from_target, from_navigated], axis=1)
