"""Injection of guided runs: the orbits that dispersed vehicles reach with the navigation errors of the runs.

Navigation errors are those along the nominal flight; their change on a dispersed flight is of second order (see
docs/decisions/0083-a-guided-run-flies-the-errors-of-the-nominal-flight.md).
"""

import numpy as np

from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import NO_INJECTIONS, NO_LOST, OUTCOMES, Floats
from lvnav_trade.simulation.preparation.prepared_case import Prepared
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES
from lvnav_trade.trajectory.guided.ascent_runs import Injection, inject
from lvnav_trade.trajectory.guided.autopilot import DrawKeys
from lvnav_trade.trajectory.guided.draws import draw
from lvnav_trade.trajectory.guided.guidance_plan import steering_times
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.orbit_numbers import orbit_difference, orbit_of
from lvnav_trade.trajectory.guided.pilots import INJECTED

_N_MOTION = 9  # outputs that every case begins with: attitude, velocity, position


def injections(prepared: Prepared, seed: int, first_run: int, errors: Floats) -> tuple[Floats, Floats]:
    """Return the injections of guided runs, and the draws of lost vehicles; empty without guidance.

    Parameters
    ----------
    prepared
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
    lost
        (n, 4). As in `RunBlock.lost`.
    """
    plan = prepared.plan
    if plan is None:
        return NO_INJECTIONS, NO_LOST
    steered = steering_times(plan, prepared.record.t)
    navigated = [
        NavigationErrors(prepared.record.t[steered], error[steered]) for error in in_inertial_axes(prepared, errors)
    ]
    drawn = [draw(plan.card, seed, first_run + k) for k in range(len(navigated))]
    words = seed_words(seed)
    results = [
        inject(plan, *pair, DrawKeys(*words, np.uint64(first_run + k)))
        for k, pair in enumerate(zip(drawn, navigated, strict=True))
    ]
    lost = [
        (first_run + k, SOURCES.index(name), number, value)
        for k, result in enumerate(results)
        if result.outcome != INJECTED
        for name, values in drawn[k].items()
        for number, value in enumerate(values)
    ]
    return rows_of(results, plan.nominal), np.array(lost, dtype=float).reshape(-1, 4)


def in_inertial_axes(prepared: Prepared, errors: Floats) -> Floats:
    """Return the errors (n_run, n_hist, 9) of attitude, velocity and position in frame i.

    errors : (n_run, n_hist, n_out), attitude in body axes, velocity and position in the reporting frame
    """
    record = prepared.record
    parts = errors[..., :_N_MOTION].reshape(*errors.shape[:2], 3, 3)
    turned = np.einsum("hij,rhj->rhi", matrices(record.q), parts[:, :, 0])
    others = np.einsum("hji,rhpj->rhpi", record.axes, parts[:, :, 1:])
    return np.concatenate([turned[:, :, None], others], axis=2).reshape(*errors.shape[:2], _N_MOTION)


def rows_of(injections: list[Injection], nominal: Floats) -> Floats:
    """Return the rows of `RunBlock.injections`; nominal: (7,) nominal state at cut-off, the target."""
    y = np.stack([item.y for item in injections])
    error = np.stack([item.error for item in injections])
    target = orbit_of(nominal[None])[0]
    achieved = orbit_of(y)
    navigated = orbit_of(y[:, :6] - error[:, [6, 7, 8, 3, 4, 5]])
    head = np.array([[OUTCOMES.index(item.outcome), item.t, item.left] for item in injections])
    parts = ((achieved, target), (achieved, navigated))
    return np.concatenate([head, *(orbit_difference(*pair) for pair in parts)], axis=1)
