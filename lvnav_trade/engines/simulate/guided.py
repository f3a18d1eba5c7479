"""What guidance makes of the navigation errors of runs: the orbits that dispersed vehicles reach.

Navigation errors are those along the nominal flight: what a dispersed flight changes of them is of second order (see
docs/decisions/0083-a-guided-run-flies-the-errors-of-the-nominal-flight.md).
"""

import numpy as np

from lvnav_trade.engines.setup.prepared import Prepared
from lvnav_trade.frames import elements_from_state, matrices
from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.records import NO_INJECTIONS, ORBIT, OUTCOMES, Floats
from lvnav_trade.world.guided.draws import draw
from lvnav_trade.world.guided.dynamics import Navigation
from lvnav_trade.world.guided.runs import Injection, inject

_N_MOTION = 9  # outputs that every case begins with: attitude, velocity, position


def injections(prepared: Prepared, seed: int, first_run: int, errors: Floats) -> Floats:
    """Return the injection (n_run, 3 + 2 n_orbit) of runs, see `RunBlock.injections`; without rows where none is
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
    found = [
        inject(plan, draw(plan.card, seed, first_run + k), Navigation(prepared.record.t, error))
        for k, error in enumerate(along)
    ]
    return rows_of(found, plan.nominal)


def in_inertial_axes(prepared: Prepared, errors: Floats) -> Floats:
    """Return errors (n_run, n_hist, 9) of attitude, velocity and position in frame i; attitude is stored in body axes,
    the others in the reporting frame.
    """
    record, parts = prepared.record, errors[..., :_N_MOTION].reshape(*errors.shape[:2], 3, 3)
    turned = np.einsum("hij,rhj->rhi", matrices(record.q), parts[:, :, 0])
    others = np.einsum("hji,rhpj->rhpi", record.axes, parts[:, :, 1:])
    return np.concatenate([turned[:, :, None], others], axis=2).reshape(*errors.shape[:2], _N_MOTION)


def rows_of(found: list[Injection], nominal: Floats) -> Floats:
    """Return the rows of `RunBlock.injections` of runs, with the nominal state (7,) at cut-off for a target."""
    y, error = np.stack([one.y for one in found]), np.stack([one.error for one in found])
    target = orbit_of(nominal[None])[0]
    achieved, navigated = orbit_of(y), orbit_of(y[:, :6] - error[:, [6, 7, 8, 3, 4, 5]])
    head = np.array([[OUTCOMES.index(one.outcome), one.t, one.left] for one in found])
    return np.concatenate([head, _difference(achieved, target), _difference(achieved, navigated)], axis=1)


def orbit_of(y: Floats) -> Floats:
    """Return the numbers of `ORBIT` of the osculating orbits of states y (n, 6 or more), (n, n_orbit)."""
    at = elements_from_state(y[:, :3], y[:, 3:6])
    a, e = at.semi_major_axis, at.eccentricity
    low, high = a * (1.0 - e) - SEMI_MAJOR, a * (1.0 + e) - SEMI_MAJOR
    turn = at.perigee_argument
    return np.stack([a, low, high, e * np.cos(turn), e * np.sin(turn), at.inclination, at.node], axis=1)


def _difference(one: Floats, other: Floats) -> Floats:
    """Return one less other, angles of the node the short way round."""
    found = one - other
    node = ORBIT.index("node")
    found[:, node] = np.remainder(found[:, node] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(found)
