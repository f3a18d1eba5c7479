"""What guidance makes of the navigation errors of runs: the orbits that dispersed vehicles reach.

Navigation errors are those along the nominal flight: what a dispersed flight changes of them is of second order (see
docs/decisions/0083-a-guided-run-flies-the-errors-of-the-nominal-flight.md).
"""

import numpy as np

from lvnav_trade.engines.setup.prepared import Prepared
from lvnav_trade.frames import matrices
from lvnav_trade.records import NO_INJECTIONS, OUTCOMES, Floats
from lvnav_trade.world.guided.draws import NO_RUN, draw
from lvnav_trade.world.guided.dynamics import Navigation
from lvnav_trade.world.guided.orbit import orbit_difference, orbit_of
from lvnav_trade.world.guided.runs import Injection, inject

_N_MOTION = 9  # outputs that every case begins with: attitude, velocity, position


def injections(prepared: Prepared, seed: int, first_run: int, errors: Floats) -> Floats:
    """Return the injection (n_run, 3 + 3 n_orbit) of runs, see `RunBlock.injections`; without rows where none is
    guided.

    Parameters
    ----------
    prepared : Prepared
    seed : Seed of the campaign.
    first_run : Number of the first run.
    errors : (n_run, n_hist, n_out). Navigation errors at the history times, reporting axes.
    """
    plan = prepared.plan
    if plan is None:
        return NO_INJECTIONS
    along = in_inertial_axes(prepared, errors)
    navigated = [Navigation(prepared.record.t, error) for error in along]
    found = [inject(plan, draw(plan.card, seed, first_run + k), error) for k, error in enumerate(navigated)]
    fixed = draw(plan.card, seed, NO_RUN)
    alone = [inject(plan, fixed, error) for error in navigated]
    return rows_of(found, alone, plan.nominal)


def in_inertial_axes(prepared: Prepared, errors: Floats) -> Floats:
    """Return errors (n_run, n_hist, 9) of attitude, velocity and position in frame i; attitude is stored in body axes,
    the others in the reporting frame.
    """
    record, parts = prepared.record, errors[..., :_N_MOTION].reshape(*errors.shape[:2], 3, 3)
    turned = np.einsum("hij,rhj->rhi", matrices(record.q), parts[:, :, 0])
    others = np.einsum("hji,rhpj->rhpi", record.axes, parts[:, :, 1:])
    return np.concatenate([turned[:, :, None], others], axis=2).reshape(*errors.shape[:2], _N_MOTION)


def rows_of(found: list[Injection], alone: list[Injection], nominal: Floats) -> Floats:
    """Return the rows of `RunBlock.injections` of runs, and of flights of the undrawn vehicle with the same navigation
    errors; the nominal state (7,) at cut-off is the target.
    """
    y, error = np.stack([one.y for one in found]), np.stack([one.error for one in found])
    target = orbit_of(nominal[None])[0]
    achieved, navigated = orbit_of(y), orbit_of(y[:, :6] - error[:, [6, 7, 8, 3, 4, 5]])
    head = np.array([[OUTCOMES.index(one.outcome), one.t, one.left] for one in found])
    by_navigation = orbit_of(np.stack([one.y for one in alone]))
    parts = ((achieved, target), (achieved, navigated), (by_navigation, target))
    return np.concatenate([head, *(orbit_difference(*pair) for pair in parts)], axis=1)
