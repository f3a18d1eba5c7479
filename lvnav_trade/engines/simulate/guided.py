"""What guidance makes of the navigation errors of runs: the orbits that dispersed vehicles reach.

Navigation errors are those along the nominal flight: what a dispersed flight changes of them is of second order (see
docs/decisions/0083-a-guided-run-flies-the-errors-of-the-nominal-flight.md).
"""

import numpy as np

from lvnav_trade.engines.setup.prepared import Prepared
from lvnav_trade.frames import elements_from_state, matrices
from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.records import NO_INJECTIONS, ORBIT, OUTCOMES, Floats
from lvnav_trade.world.guided.draws import draw, numbers
from lvnav_trade.world.guided.dynamics import Navigation
from lvnav_trade.world.guided.reference import Plan
from lvnav_trade.world.guided.runs import Injection, inject

NO_RUN = -1  # number that stands for a vehicle of which nothing is drawn
CIRCULAR = 1e-4
"""Eccentricity below which perigee and apogee have no derivative worth the name: 0.7 km of either height."""
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
    return np.concatenate([head, *(_difference(*pair) for pair in parts)], axis=1)


def vehicle_budget(prepared: Prepared) -> dict[str, Floats]:
    """Return one sigma (n_orbit,) that each dispersed source of the vehicle gives the achieved orbit, to first order.

    Central differences of whole flights of one sigma of every number of a source, its numbers being independent, with a
    navigation without errors: guidance, cut-off and all events are as they are flown. Perigee and apogee follow from
    axis and eccentricity vector of the target; they are NaN of a circular one.
    """
    plan = prepared.plan
    if plan is None or plan.card.dispersion is None:
        return {}
    fixed = draw(plan.card, 0, NO_RUN)
    found: dict[str, Floats] = {}
    for name in plan.card.dispersion.drawn:
        if dict(plan.spreads).get(name, 0.0) > 0.0:
            slopes = [_slope(plan, fixed, name, k) for k in range(numbers(plan.card)[name])]
            found[name] = np.sqrt(np.sum(np.square(slopes), axis=0))
    return found


def _slope(plan: Plan, fixed: dict[str, Floats], name: str, k: int) -> Floats:
    """Return the change (n_orbit,) of the orbit by one sigma of number k of a source."""
    ends = []
    for sign in (1.0, -1.0):
        one = fixed.get(name, np.zeros(numbers(plan.card)[name])).copy()
        one[k] += sign
        ends.append(orbit_of(inject(plan, {**fixed, name: one}).y[None])[0])
    change = 0.5 * _difference(ends[0][None], ends[1][None])[0]
    target = dict(zip(ORBIT, orbit_of(plan.nominal[None])[0], strict=True))
    vector = np.array([target["eccentricity_along_node"], target["eccentricity_ahead_of_node"]])
    size, a = np.linalg.norm(vector), target["semi_major_axis"]
    longer = change[ORBIT.index("semi_major_axis")]
    moved = change[[ORBIT.index("eccentricity_along_node"), ORBIT.index("eccentricity_ahead_of_node")]]
    stretched = vector @ moved / size if size > CIRCULAR else np.nan
    change[ORBIT.index("perigee")] = longer * (1.0 - size) - a * stretched
    change[ORBIT.index("apogee")] = longer * (1.0 + size) + a * stretched
    return change


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
